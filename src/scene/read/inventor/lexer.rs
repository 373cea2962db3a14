//! Characters → tokens of Open Inventor and VRML text, every token with the byte offset where it starts.
//!
//! Commas count as white space, as the format's own reader treats them wherever real files put them. A
//! comment runs from `#` to the end of the line. Lines end in `\n`, `\r\n` or (old Macintosh files) a lone
//! `\r`.

use std::borrow::Cow;

/// A fault in the text: where, and what the reader makes of it. the caller turns it into an error with a file
/// name.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// Byte offset into the text.
    pub at: usize,
    /// What the grammar allows here.
    pub expected: String,
    /// What stands here.
    pub found: String,
    /// What the user can do.
    pub remedy: String,
}

impl Fault {
    /// A fault at byte `at`.
    pub fn new(
        at: usize,
        expected: impl Into<String>,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Fault {
        Fault { at, expected: expected.into(), found: found.into(), remedy: remedy.into() }
    }
}

/// A token; words and strings borrow the text.
#[derive(Clone, Debug, PartialEq)]
pub enum Token<'t> {
    /// One of `{ } [ ] ( ) = ~ |`.
    Mark(u8),
    /// A name, keyword or number.
    Word(&'t str),
    /// A quoted string without its quotes, escapes resolved.
    Text(Cow<'t, str>),
    /// The end of the file.
    End,
}

impl Token<'_> {
    /// The token as an error message shows it.
    pub fn shown(&self) -> String {
        match self {
            Token::Mark(mark) => format!("`{}`", *mark as char),
            Token::Word(word) => format!("`{}`", shortened(word)),
            Token::Text(text) => format!("the string \"{}\"", shortened(text)),
            Token::End => "the end of the file".to_owned(),
        }
    }
}

/// At most 40 characters, control characters escaped.
fn shortened(text: &str) -> String {
    let mut shown: String = text.chars().take(40).flat_map(char::escape_debug).collect();
    if text.chars().nth(40).is_some() {
        shown.push('…');
    }
    shown
}

/// The tokens of a text, on demand.
#[derive(Clone)]
pub struct Lexer<'t> {
    text: &'t str,
    at: usize,
    /// VRML97 strings: a backslash always escapes the character after it.
    vrml97: bool,
}

/// What the lexer says of a token: the token and its first byte.
pub type Lexed<'t> = Result<(Token<'t>, usize), Fault>;

impl<'t> Lexer<'t> {
    /// Starts at the beginning of `text`.
    pub fn new(text: &'t str, vrml97: bool) -> Self {
        Lexer { text, at: 0, vrml97 }
    }

    /// The offset of the next token, after white space and comments.
    pub fn position(&mut self) -> usize {
        let bytes = self.text.as_bytes();
        while let Some(byte) = bytes.get(self.at) {
            match byte {
                b' ' | b'\t' | b'\n' | b'\r' | b',' | 0x0b | 0x0c => self.at += 1,
                b'#' => {
                    let rest = &bytes[self.at..];
                    self.at += rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(rest.len());
                }
                _ => break,
            }
        }
        self.at
    }

    /// The next byte after white space, without consuming it.
    pub fn peek_byte(&mut self) -> Option<u8> {
        let at = self.position();
        self.text.as_bytes().get(at).copied()
    }

    /// The next token, without consuming it.
    pub fn peek(&mut self) -> Lexed<'t> {
        self.position();
        self.clone().take()
    }

    /// The next token.
    pub fn take(&mut self) -> Lexed<'t> {
        let start = self.position();
        let token = match self.text.as_bytes().get(start) {
            None => Token::End,
            Some(b'"') => Token::Text(self.string(start)?),
            Some(mark) if is_mark(*mark) => {
                self.at += 1;
                Token::Mark(*mark)
            }
            Some(_) => Token::Word(self.run(|b| is_mark(b) || b == b'"' || b == b'#')),
        };
        Ok((token, start))
    }

    /// A name after `DEF` or `USE`: it may hold characters that are marks elsewhere, such as `=`, `(` or `#`.
    pub fn name(&mut self) -> Result<(&'t str, usize), Fault> {
        let start = self.position();
        let name = self.run(|b| matches!(b, b'{' | b'}' | b'[' | b']' | b'"'));
        if name.is_empty() {
            let found = self.clone().take()?.0.shown();
            return Err(Fault::new(start, "a name after DEF or USE", found, "give the node a name"));
        }
        Ok((name, start))
    }

    /// A number: decimal, or hexadecimal `0x…`; `nan`, `inf` and Microsoft's `1.#QNAN` included.
    pub fn number(&mut self) -> Option<f64> {
        let start = self.position();
        let word = self.run(|b| is_mark(b) || b == b'"' || b == b'#');
        if word.ends_with('.') && self.text[self.at..].starts_with("#") {
            let special = self.microsoft_special();
            if special.is_some() {
                return special;
            }
        }
        let number = parse_number(word);
        if number.is_none() {
            self.at = start;
        }
        number
    }

    /// The rest of `1.#QNAN`, `-1.#IND`, `1.#INF`: not a number and infinity as old C libraries print them.
    fn microsoft_special(&mut self) -> Option<f64> {
        let rest = &self.text.as_bytes()[self.at + 1..];
        let length = rest.iter().position(|b| !b.is_ascii_alphanumeric()).unwrap_or(rest.len());
        let value = match rest.get(..4.min(length))? {
            b"QNAN" | b"SNAN" => f64::NAN,
            [b'I', b'N', b'D', ..] => f64::NAN,
            [b'I', b'N', b'F', ..] => f64::INFINITY,
            _ => return None,
        };
        self.at += 1 + length;
        Some(value)
    }

    /// The bytes up to white space, a comma, or a byte that `ends` a word; never empty unless such a byte
    /// comes first.
    fn run(&mut self, ends: impl Fn(u8) -> bool) -> &'t str {
        let start = self.at;
        let rest = &self.text.as_bytes()[start..];
        let blank = |b: u8| matches!(b, b' ' | b'\t' | b'\n' | b'\r' | b',' | 0x0b | 0x0c);
        self.at += rest.iter().position(|b| blank(*b) || ends(*b)).unwrap_or(rest.len());
        // Only ASCII bytes end a run, so this cuts between characters.
        &self.text[start..self.at]
    }

    /// A string from its opening quote at `start`.
    ///
    /// Inventor escapes only the quote, and a backslash before a quote that ends the line stands for itself:
    /// `"C:\"` is a whole string there. VRML97 escapes whatever follows a backslash.
    fn string(&mut self, start: usize) -> Result<Cow<'t, str>, Fault> {
        let bytes = self.text.as_bytes();
        let mut out: Option<String> = None;
        let (mut from, mut i) = (start + 1, start + 1);
        while let Some(byte) = bytes.get(i) {
            let escapes = match (byte, bytes.get(i + 1)) {
                (b'\\', Some(b'"')) => self.vrml97 || !matches!(bytes.get(i + 2), None | Some(b'\n' | b'\r')),
                (b'\\', Some(b'\\')) => self.vrml97,
                _ => false,
            };
            if escapes {
                let text = out.get_or_insert_default();
                text.push_str(&self.text[from..i]);
                (from, i) = (i + 1, i + 2);
            } else if *byte == b'"' {
                self.at = i + 1;
                let tail = &self.text[from..i];
                return Ok(match out {
                    Some(text) => Cow::Owned(text + tail),
                    None => Cow::Borrowed(tail),
                });
            } else {
                i += 1;
            }
        }
        Err(Fault::new(
            start,
            "a string closed by `\"`",
            "the end of the file",
            "close the string that starts here; write a quote inside it as `\\\"`",
        ))
    }
}

fn is_mark(byte: u8) -> bool {
    matches!(byte, b'{' | b'}' | b'[' | b']' | b'(' | b')' | b'=' | b'~' | b'|')
}

/// A decimal or `0x…` number.
pub fn parse_number(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| hexadecimal(word).map(|n| n as f64))
}

/// An integer as C reads it: decimal, `0x…`, or octal after a leading 0.
pub fn parse_integer(word: &str) -> Option<i64> {
    let digits = word.strip_prefix(['+', '-']).unwrap_or(word);
    if digits.len() > 1 && digits.starts_with('0') && digits.bytes().all(|b| matches!(b, b'0'..=b'7')) {
        let magnitude = i64::from_str_radix(digits, 8).ok()?;
        return Some(if word.starts_with('-') { -magnitude } else { magnitude });
    }
    word.parse().ok().or_else(|| hexadecimal(word))
}

fn hexadecimal(word: &str) -> Option<i64> {
    let (sign, digits) = word.strip_prefix('-').map_or((1, word), |rest| (-1, rest));
    let digits = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X"))?;
    let plain = digits.bytes().all(|b| b.is_ascii_hexdigit());
    plain.then(|| i64::from_str_radix(digits, 16).ok())?.map(|n| sign * n)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tokens(text: &str, vrml97: bool) -> Vec<String> {
        let mut lexer = Lexer::new(text, vrml97);
        let mut all = Vec::new();
        loop {
            match lexer.take() {
                Ok((Token::End, _)) => return all,
                Ok((token, at)) => all.push(format!("{at}:{}", token.shown())),
                Err(fault) => {
                    all.push(format!("{}!{}", fault.at, fault.expected));
                    return all;
                }
            }
        }
    }

    #[test]
    fn marks_words_and_comments_come_apart() {
        assert_eq!(
            tokens("Cube{width 5#wide\r}, a.b", false),
            ["0:`Cube`", "4:`{`", "5:`width`", "11:`5`", "18:`}`", "21:`a.b`"]
        );
    }

    #[test]
    fn inventor_escapes_only_quotes_that_do_not_end_the_line() {
        assert_eq!(tokens("\"\\\"\"\n\"\\\"\n\"\\\\\"\n", false).len(), 3);
        assert_eq!(tokens("\"\\\" ]\" x", false), ["0:the string \"\\\" ]\"", "7:`x`"]);
        assert_eq!(tokens("\"\\\" \n}", false), ["0!a string closed by `\"`"]);
        assert_eq!(tokens("\"\\\\\" \"\\\"\nb\"", true).len(), 2);
    }

    #[test]
    fn numbers_take_every_spelling_seen_in_files() {
        for (text, value) in
            [("+1.5e2", 150.0), (".5", 0.5), ("5.", 5.0), ("0xff", 255.0), ("-3,", -3.0), ("2#c", 2.0)]
        {
            assert_eq!(Lexer::new(text, false).number(), Some(value), "{text}");
        }
        for text in ["nan", "-NaN", "1.#QNAN", "-1.#IND00 4"] {
            assert!(Lexer::new(text, false).number().unwrap().is_nan(), "{text}");
        }
        for text in ["a", "0x", "0x-1", "", "}", "1.2.3"] {
            assert_eq!(Lexer::new(text, false).number(), None, "{text}");
        }
        assert_eq!(
            (parse_integer("010"), parse_integer("-0x10"), parse_integer("08")),
            (Some(8), Some(-16), Some(8))
        );
        assert_eq!((parse_integer("1.5"), parse_integer("99999999999999999999")), (None, None));
    }
}
