//! The values of fields: by the form the schema states for fields that matter, by their shape for all others.

use super::document::Value;
use super::grammar::{Parser, is_type_name, no_node};
use super::lexer::{Fault, Token, parse_integer, parse_number};
use super::schema::Form;

impl<'t> Parser<'t> {
    /// The value of field `name`, whose name has just been read; `None` when it is left to a connection.
    pub(super) fn field(
        &mut self,
        name: &'static str,
        form: Form,
        node: &str,
    ) -> Result<Option<Value>, Fault> {
        let field = Field { name, node };
        let written = !matches!(self.lexer.peek_byte(), Some(b'~' | b'=')) && !self.is_connection97()?;
        let value = match written {
            true => Some(self.value(form, &field)?),
            false => None,
        };
        Ok(if self.suffixes()? { Some(Value::Ignored) } else { value })
    }

    /// A field without a known form, whose name has just been read.
    pub(super) fn unknown_field(&mut self, name: &str) -> Result<(), Fault> {
        if !matches!(self.lexer.peek_byte(), Some(b'~' | b'=')) && !self.is_connection97()? {
            self.any_value(name)?;
        }
        self.suffixes().map(drop)
    }

    /// What may follow a value: a connection `= Node { … } . output`, which is read and dropped, and the flag
    /// `~`, which is returned.
    fn suffixes(&mut self) -> Result<bool, Fault> {
        let mut ignored = false;
        loop {
            match self.lexer.peek_byte() {
                Some(b'~') => ignored = true,
                Some(b'=') => {}
                _ => return Ok(ignored),
            }
            if let (Token::Mark(b'='), _) = self.lexer.take()? {
                self.connection()?;
            }
        }
    }

    /// The source of a connection: a node, then a dot and the name of its output, with white space anywhere.
    fn connection(&mut self) -> Result<(), Fault> {
        let glued = match self.lexer.peek()? {
            (Token::Word("USE"), _) => {
                self.lexer.take()?;
                self.instance(true)?.1
            }
            _ => {
                self.node()?;
                false
            }
        };
        self.skip("field connection".to_owned());
        if glued {
            return Ok(());
        }
        match self.lexer.take()? {
            (Token::Word("."), _) => match self.lexer.take()? {
                (Token::Word(_), _) => Ok(()),
                (token, at) => Err(no_output(&token, at)),
            },
            (Token::Word(word), _) if word.starts_with('.') => Ok(()),
            (token, at) => Err(no_output(&token, at)),
        }
    }

    fn value(&mut self, form: Form, field: &Field) -> Result<Value, Fault> {
        match form {
            Form::Float(n) => {
                let mut numbers = Vec::with_capacity(n);
                for i in 0..n {
                    numbers.push(self.float(field, i, n)?);
                }
                Ok(Value::Numbers(numbers.into()))
            }
            Form::Floats(n) => self.floats(n, field),
            Form::Integers => self.integers(field),
            Form::Flag => {
                let word = self.one_of(&["TRUE", "FALSE", "1", "0"], field)?;
                Ok(Value::Numbers([f64::from(u8::from(matches!(word, "TRUE" | "1")))].into()))
            }
            Form::OneOf(words) => Ok(Value::Words(vec![self.one_of(words, field)?])),
            Form::Bits(words) => self.bits(words, field),
            Form::Strings => self.strings(field),
            Form::Nodes => {
                let mut nodes = Vec::new();
                self.list(field, "a node", |parser| {
                    nodes.push(parser.node()?);
                    Ok(())
                })?;
                Ok(Value::Nodes(nodes))
            }
            Form::Node => match self.lexer.peek()? {
                (Token::Word("NULL"), _) => {
                    self.lexer.take()?;
                    Ok(Value::Nodes(Vec::new()))
                }
                _ => Ok(Value::Nodes(vec![self.node()?])),
            },
        }
    }

    /// One number of `n`, counted from 0.
    fn float(&mut self, field: &Field, i: usize, n: usize) -> Result<f64, Fault> {
        match self.lexer.number() {
            Some(number) => Ok(number),
            None => {
                let (token, at) = self.lexer.take()?;
                let which = if n == 1 { "a number".to_owned() } else { format!("number {} of {n}", i + 1) };
                Err(Fault::new(at, format!("{which} for {field}"), token.shown(), "write the missing number"))
            }
        }
    }

    /// Any multiple of `n` numbers in brackets, or just `n`.
    fn floats(&mut self, n: usize, field: &Field) -> Result<Value, Fault> {
        let mut numbers = Vec::new();
        if self.lexer.peek_byte() != Some(b'[') {
            return self.value(Form::Float(n), field);
        }
        self.lexer.take()?;
        while self.lexer.peek_byte() != Some(b']') {
            match self.lexer.number() {
                Some(number) => numbers.push(number),
                None => {
                    let (token, at) = self.lexer.take()?;
                    let expected = format!("a number for {field}, or `]` to end it");
                    return Err(Fault::new(at, expected, token.shown(), "close the list with `]`"));
                }
            }
        }
        let (_, at) = self.lexer.take()?;
        if numbers.len() % n != 0 {
            return Err(Fault::new(
                at,
                format!("a multiple of {n} numbers for {field}"),
                format!("`]` after {}", numbers.len()),
                "add or remove numbers",
            ));
        }
        Ok(Value::Numbers(numbers.into()))
    }

    fn integers(&mut self, field: &Field) -> Result<Value, Fault> {
        let mut numbers = Vec::new();
        self.list(field, "an integer", |parser| match parser.lexer.take()? {
            (Token::Word(word), at) => match parse_integer(word) {
                Some(number) => {
                    numbers.push(number as f64);
                    Ok(())
                }
                None => Err(no_value("an integer", field, &Token::Word(word), at)),
            },
            (token, at) => Err(no_value("an integer", field, &token, at)),
        })?;
        Ok(Value::Numbers(numbers.into()))
    }

    fn strings(&mut self, field: &Field) -> Result<Value, Fault> {
        let mut strings = Vec::new();
        self.list(field, "a string", |parser| match parser.lexer.take()? {
            (Token::Text(text), _) => {
                strings.push(text.into_owned());
                Ok(())
            }
            // Strings without blanks may go without quotes.
            (Token::Word(word), _) => {
                strings.push(word.to_owned());
                Ok(())
            }
            (token, at) => Err(no_value("a string", field, &token, at)),
        })?;
        Ok(Value::Strings(strings))
    }

    /// Items in brackets, or one item.
    fn list(
        &mut self,
        field: &Field,
        what: &str,
        mut item: impl FnMut(&mut Self) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        if self.lexer.peek_byte() != Some(b'[') {
            return item(self);
        }
        self.lexer.take()?;
        loop {
            match self.lexer.peek_byte() {
                Some(b']') => return self.lexer.take().map(drop),
                None => {
                    let at = self.lexer.position();
                    let expected = format!("{what} for {field}, or `]` to end it");
                    return Err(Fault::new(at, expected, Token::End.shown(), "close the list with `]`"));
                }
                Some(_) => item(self)?,
            }
        }
    }

    fn one_of(&mut self, words: &[&'static str], field: &Field) -> Result<&'static str, Fault> {
        let (token, at) = self.lexer.take()?;
        let known = match &token {
            Token::Word(word) => words.iter().find(|known| *known == word),
            _ => None,
        };
        known.copied().ok_or_else(|| {
            Fault::new(
                at,
                format!("one of {} for {field}", words.join(", ")),
                token.shown(),
                "use one of these values",
            )
        })
    }

    fn bits(&mut self, words: &[&'static str], field: &Field) -> Result<Value, Fault> {
        if self.lexer.peek_byte() != Some(b'(') {
            return Ok(Value::Words(vec![self.one_of(words, field)?]));
        }
        let mut set = Vec::new();
        loop {
            match self.lexer.peek_byte() {
                Some(b')') => {
                    self.lexer.take()?;
                    return Ok(Value::Words(set));
                }
                Some(b'(' | b'|') => self.lexer.take().map(drop)?,
                _ => set.push(self.one_of(words, field)?),
            }
        }
    }

    /// Any value, recognised by its shape: a bracketed list, a bit mask, numbers, a string, a node, or a
    /// single word.
    pub(super) fn any_value(&mut self, field: &str) -> Result<(), Fault> {
        match self.lexer.peek()? {
            (Token::Mark(b'['), _) => {
                self.lexer.take()?;
                while self.lexer.peek_byte() != Some(b']') {
                    if self.lexer.number().is_none() {
                        self.any_item(field)?;
                    }
                }
                self.lexer.take().map(drop)
            }
            (Token::Mark(b'('), _) => {
                self.lexer.take()?;
                loop {
                    match self.lexer.take()? {
                        (Token::Mark(b')'), _) => return Ok(()),
                        (Token::Word(_) | Token::Mark(b'|'), _) => {}
                        (token, at) => {
                            let expected = format!("a word or `)` in the value of `{field}`");
                            return Err(Fault::new(
                                at,
                                expected,
                                token.shown(),
                                "close the bit mask with `)`",
                            ));
                        }
                    }
                }
            }
            (Token::Word(word), _) if parse_number(word).is_some() => {
                while self.lexer.number().is_some() {}
                Ok(())
            }
            _ => self.any_item(field),
        }
    }

    /// A string, a node or a word.
    fn any_item(&mut self, field: &str) -> Result<(), Fault> {
        match self.lexer.peek()? {
            (Token::Word("DEF" | "USE"), _) => self.node().map(drop),
            (Token::Word(word), at) => {
                self.lexer.take()?;
                if is_type_name(word) && self.lexer.peek_byte() == Some(b'{') {
                    self.node_of_type(word, at, None)?;
                } else if self.vrml97
                    && !word.starts_with(|c: char| c.is_alphanumeric() || "_+-.".contains(c))
                {
                    return Err(no_node(&Token::Word(word), at));
                }
                Ok(())
            }
            (Token::Text(_), _) => self.lexer.take().map(drop),
            (token, at) => {
                let expected = format!("a value for the field `{field}`");
                Err(Fault::new(at, expected, token.shown(), "write the value, or remove the field"))
            }
        }
    }
}

/// A field as messages call it.
pub(super) struct Field<'a> {
    name: &'static str,
    node: &'a str,
}

impl std::fmt::Display for Field<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the field `{}` of `{}`", self.name, self.node)
    }
}

fn no_value(what: &str, field: &Field, token: &Token, at: usize) -> Fault {
    Fault::new(at, format!("{what} for {field}"), token.shown(), "write the missing value")
}

fn no_output(token: &Token, at: usize) -> Fault {
    let expected = "`.` and the name of an output after a connected node";
    Fault::new(at, expected, token.shown(), "write the connection as `= Node { … } . output`")
}
