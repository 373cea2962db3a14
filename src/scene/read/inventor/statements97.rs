//! The statements VRML97 adds to the grammar: `PROTO`, `EXTERNPROTO`, `ROUTE`, interface declarations of
//! scripts, and `IS`.
//!
//! They are checked and left out: a prototype's instances count as skipped nodes, and nothing moves here that
//! a route could drive.

use super::grammar::{Parser, is_type_name};
use super::lexer::{Fault, Token};

impl<'t> Parser<'t> {
    /// Reads a statement that starts with `word`, the next token, if it is one; says whether it was.
    pub(super) fn statement97(&mut self, word: &str) -> Result<bool, Fault> {
        if !self.vrml97 {
            return Ok(false);
        }
        match word {
            "ROUTE" => self.route()?,
            "PROTO" => self.prototype()?,
            "EXTERNPROTO" => self.external_prototype()?,
            "eventIn" | "eventOut" | "field" | "exposedField" => self.declaration(true).map(drop)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Whether the value of a field is `IS name`, which is then read: a connection to the interface of the
    /// prototype around it.
    pub(super) fn is_connection97(&mut self) -> Result<bool, Fault> {
        if !self.vrml97 || !matches!(self.lexer.peek()?, (Token::Word("IS"), _)) {
            return Ok(false);
        }
        self.lexer.take()?;
        let (name, at) = self.identifier("the name of a field of the prototype")?;
        let known = self.interfaces.last().is_some_and(|names| names.contains(&name));
        if known {
            return Ok(true);
        }
        Err(Fault::new(
            at,
            "a field that the interface of the PROTO declares",
            format!("`IS {name}`"),
            "declare the field in the interface of the PROTO, or write a value",
        ))
    }

    /// `ROUTE node.output TO node.input`.
    fn route(&mut self) -> Result<(), Fault> {
        self.lexer.take()?;
        self.route_end()?;
        match self.lexer.take()? {
            (Token::Word("TO"), _) => self.route_end(),
            (token, at) => {
                Err(Fault::new(at, "`TO`", token.shown(), "write ROUTE node.output TO node.input"))
            }
        }
    }

    fn route_end(&mut self) -> Result<(), Fault> {
        let (word, at) = self.identifier("`node.event`")?;
        let node = word.split_once('.').map(|(node, _)| node);
        match node {
            Some(node) if self.names.contains_key(node) => Ok(()),
            _ => Err(Fault::new(
                at,
                "`node.event` of a node named by DEF further up",
                format!("`{word}`"),
                "define the node before the route, or remove the route",
            )),
        }
    }

    /// `PROTO name [ declarations ] { nodes and statements }`.
    fn prototype(&mut self) -> Result<(), Fault> {
        self.lexer.take()?;
        let (_, at) = self.identifier("the name of the prototype")?;
        let interface = self.interface(true)?;
        self.expect_mark(b'{', "`{` before the body of the PROTO", "write PROTO name [ … ] { … }")?;
        self.interfaces.push(interface);
        if self.interfaces.len() > 32 {
            return Err(Fault::new(at, "at most 32 nested PROTOs", "one more", "flatten the prototypes"));
        }
        // Names inside a prototype are its own.
        let outside = std::mem::take(&mut self.names);
        loop {
            match self.lexer.peek()? {
                (Token::Mark(b'}'), _) => break,
                (Token::Word(word), _) if self.statement97(word)? => {}
                _ => self.node().map(drop)?,
            }
        }
        self.lexer.take()?;
        self.names = outside;
        self.interfaces.pop();
        self.skip("PROTO".to_owned());
        Ok(())
    }

    /// `EXTERNPROTO name [ declarations ] "url"`.
    fn external_prototype(&mut self) -> Result<(), Fault> {
        self.lexer.take()?;
        self.identifier("the name of the prototype")?;
        self.interface(false)?;
        self.any_value("EXTERNPROTO")?;
        self.skip("EXTERNPROTO".to_owned());
        Ok(())
    }

    fn interface(&mut self, with_values: bool) -> Result<Vec<&'t str>, Fault> {
        self.expect_mark(
            b'[',
            "`[` before the interface",
            "write the interface as [ field SFFloat size 1 ]",
        )?;
        let mut names = Vec::new();
        loop {
            match self.lexer.peek()? {
                (Token::Mark(b']'), _) => {
                    self.lexer.take()?;
                    return Ok(names);
                }
                (Token::Word("eventIn" | "eventOut" | "field" | "exposedField"), _) => {
                    names.push(self.declaration(with_values)?);
                }
                (token, at) => {
                    let expected = "eventIn, eventOut, field or exposedField, or `]` to end the interface";
                    return Err(Fault::new(at, expected, token.shown(), "close the interface with `]`"));
                }
            }
        }
    }

    /// `field SFFloat size 1` and its like; events have no value.
    fn declaration(&mut self, with_value: bool) -> Result<&'t str, Fault> {
        let (keyword, _) = self.identifier("a declaration")?;
        self.identifier("the type of the field")?;
        let (name, _) = self.identifier("the name of the field")?;
        if !self.is_connection97()? && with_value && matches!(keyword, "field" | "exposedField") {
            self.any_value(name)?;
        }
        Ok(name)
    }

    fn identifier(&mut self, what: &str) -> Result<(&'t str, usize), Fault> {
        match self.lexer.take()? {
            (Token::Word(word), at) if is_type_name(word) => Ok((word, at)),
            (token, at) => Err(Fault::new(at, what, token.shown(), "complete the statement")),
        }
    }
}
