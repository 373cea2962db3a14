//! Formulas of metrics: numbers, event names, `+ - * /` and parentheses.

use super::Reading;

/// A parsed formula.
#[derive(Clone, Debug, PartialEq)]
pub enum Formula {
    /// A constant.
    Number(f64),
    /// The value of an event.
    Event(String),
    /// Two formulas and what joins them: one of `+ - * /`.
    Binary(Box<Self>, char, Box<Self>),
}

/// Nesting beyond this is refused rather than risked.
const MAX_DEPTH: usize = 64;

impl Formula {
    /// Parses a formula; the error says what was expected where.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut parser = Parser { rest: text.trim_start(), depth: 0 };
        let formula = parser.sum()?;
        if parser.rest.is_empty() { Ok(formula) } else { Err(parser.expected("an operator or the end")) }
    }

    /// The events it needs.
    pub fn events(&self) -> Vec<&str> {
        match self {
            Self::Number(_) => Vec::new(),
            Self::Event(name) => vec![name],
            Self::Binary(left, _, right) => {
                let mut events = left.events();
                events.extend(right.events());
                events
            }
        }
    }

    /// Its value; unavailable where an event is, or where it divides by 0.
    pub fn evaluate(&self, value_of: &dyn Fn(&str) -> Reading) -> Reading {
        match self {
            Self::Number(number) => Reading::Value(*number),
            Self::Event(name) => value_of(name),
            Self::Binary(left, operator, right) => {
                let (left, right) = match (left.evaluate(value_of), right.evaluate(value_of)) {
                    (Reading::Value(left), Reading::Value(right)) => (left, right),
                    (Reading::Unavailable(reason), _) | (_, Reading::Unavailable(reason)) => {
                        return Reading::Unavailable(reason);
                    }
                };
                match operator {
                    '+' => Reading::Value(left + right),
                    '-' => Reading::Value(left - right),
                    '*' => Reading::Value(left * right),
                    _ if right == 0.0 => Reading::Unavailable("nothing was counted to divide by".to_owned()),
                    _ => Reading::Value(left / right),
                }
            }
        }
    }
}

struct Parser<'t> {
    rest: &'t str,
    depth: usize,
}

impl Parser<'_> {
    fn expected(&self, what: &str) -> String {
        let found = if self.rest.is_empty() { "the end" } else { self.rest };
        format!("expected {what}, found {found:?}")
    }

    fn eat(&mut self, operators: &[char]) -> Option<char> {
        let first = self.rest.chars().next().filter(|first| operators.contains(first))?;
        self.rest = self.rest[first.len_utf8()..].trim_start();
        Some(first)
    }

    fn sum(&mut self) -> Result<Formula, String> {
        let mut left = self.product()?;
        while let Some(operator) = self.eat(&['+', '-']) {
            left = Formula::Binary(Box::new(left), operator, Box::new(self.product()?));
        }
        Ok(left)
    }

    fn product(&mut self) -> Result<Formula, String> {
        let mut left = self.atom()?;
        while let Some(operator) = self.eat(&['*', '/']) {
            left = Formula::Binary(Box::new(left), operator, Box::new(self.atom()?));
        }
        Ok(left)
    }

    fn atom(&mut self) -> Result<Formula, String> {
        if self.eat(&['(']).is_some() {
            self.depth += 1;
            if self.depth > MAX_DEPTH {
                return Err(format!("more than {MAX_DEPTH} nested parentheses"));
            }
            let inner = self.sum()?;
            self.depth -= 1;
            return self.eat(&[')']).map(|_| inner).ok_or_else(|| self.expected("`)`"));
        }
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.';
        let end = self.rest.find(|c| !is_word(c)).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        let formula = match word.chars().next() {
            Some(first) if first.is_ascii_digit() => {
                Formula::Number(word.parse().map_err(|_| self.expected("a number"))?)
            }
            Some(first) if first.is_ascii_alphabetic() => Formula::Event(word.to_owned()),
            _ => return Err(self.expected("a number, an event or `(`")),
        };
        self.rest = rest.trim_start();
        Ok(formula)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> Reading {
        let events = |name: &str| match name {
            "A" => Reading::Value(6.0),
            "B" => Reading::Value(3.0),
            "ZERO" => Reading::Value(0.0),
            _ => Reading::Unavailable(format!("no {name}")),
        };
        Formula::parse(text).unwrap().evaluate(&events)
    }

    #[test]
    fn operators_bind_as_usual() {
        for (text, expected) in
            [("1 - A / B", -1.0), ("A-B-1", 2.0), ("A / B / 2", 1.0), ("2*(A+B)", 18.0), ("9.01 * B", 27.03)]
        {
            assert_eq!(value(text), Reading::Value(expected), "{text}");
        }
    }

    #[test]
    fn what_is_missing_is_named_and_never_zero() {
        assert_eq!(value("A / MISSING"), Reading::Unavailable("no MISSING".to_owned()));
        assert!(matches!(value("A / ZERO"), Reading::Unavailable(_)));
    }

    #[test]
    fn bad_formulas_are_refused() {
        let deep = "(".repeat(100_000);
        for text in ["", "A +", "(A", "A)", "A B", "1.2.3", "A ^ 2", "ß", &deep] {
            assert!(Formula::parse(text).is_err(), "{text}");
        }
    }
}
