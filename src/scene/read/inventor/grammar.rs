//! Tokens → [`Document`]: the grammar of Open Inventor and VRML text.
//!
//! A hand-written recursive descent instead of a combinator library: whether `name` starts a child node, a
//! field of a known form or an unknown field depends on the node type around it and on one token of
//! look-ahead; every error names what the schema wants at that very column; and numbers, nine tenths of any
//! file, are parsed in place without becoming tokens. Recursion is bounded by [`MAX_DEPTH`].

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::document::{Document, Node, NodeId, Value};
use super::lexer::{Fault, Lexer, Token};
use super::schema::{self, Form, Kind, Spec};

/// Nodes may be nested this deep, in one file and along a path through instances and includes.
///
/// Real files stay below 50; a path of this length needs less than a megabyte of stack.
pub const MAX_DEPTH: usize = 400;

/// Parses the text of one file whose header has been read already.
pub fn parse(text: String, path: &Path, vrml97: bool) -> Result<Document, (String, Fault)> {
    let mut parser = Parser {
        lexer: Lexer::new(&text, vrml97),
        vrml97,
        nodes: Vec::new(),
        skipped: BTreeMap::new(),
        names: HashMap::new(),
        open: Vec::new(),
        interfaces: Vec::new(),
        depth: 0,
    };
    match parser.document() {
        Ok(roots) => {
            let (nodes, skipped) = (parser.nodes, parser.skipped);
            Ok(Document { path: path.to_owned(), text, vrml97, nodes, roots, skipped })
        }
        Err(fault) => Err((text, fault)),
    }
}

pub(super) struct Parser<'t> {
    pub(super) lexer: Lexer<'t>,
    pub(super) vrml97: bool,
    nodes: Vec<Node>,
    pub(super) skipped: BTreeMap<String, u64>,
    /// `DEF` names, each pointing at the latest node that bears it.
    pub(super) names: HashMap<&'t str, NodeId>,
    /// Names whose bodies are being read.
    open: Vec<&'t str>,
    /// Field names of the `PROTO`s being read, innermost last.
    pub(super) interfaces: Vec<Vec<&'t str>>,
    depth: usize,
}

impl<'t> Parser<'t> {
    fn document(&mut self) -> Result<Vec<NodeId>, Fault> {
        let mut roots = Vec::new();
        loop {
            match self.lexer.peek()? {
                (Token::End, _) => return Ok(roots),
                (Token::Word(word), _) if self.statement97(word)? => {}
                _ => roots.push(self.node()?),
            }
        }
    }

    /// A node: `Type { … }`, `DEF name Type { … }` or `USE name`.
    pub(super) fn node(&mut self) -> Result<NodeId, Fault> {
        match self.lexer.take()? {
            (Token::Word("USE"), _) => Ok(self.instance(false)?.0),
            (Token::Word("DEF"), _) => {
                let (name, _) = self.lexer.name()?;
                self.open.push(name);
                let (word, at) = self.node_type()?;
                let id = self.node_of_type(word, at, Some(name))?;
                self.open.pop();
                self.names.insert(name, id);
                Ok(id)
            }
            (Token::Word(word), at) if is_type_name(word) => self.node_of_type(word, at, None),
            (token, at) => Err(no_node(&token, at)),
        }
    }

    fn node_type(&mut self) -> Result<(&'t str, usize), Fault> {
        match self.lexer.take()? {
            (Token::Word(word), at) if is_type_name(word) => Ok((word, at)),
            (token, at) => Err(no_node(&token, at)),
        }
    }

    /// What follows `USE`: the node, and whether the name of an output is glued to its name, which only a
    /// connection allows: `= USE name.output`.
    pub(super) fn instance(&mut self, connected: bool) -> Result<(NodeId, bool), Fault> {
        let (name, at) = self.lexer.name()?;
        if let Some(id) = self.names.get(name) {
            return Ok((*id, false));
        }
        let glued = name.rsplit_once('.').filter(|_| connected);
        if let Some(id) = glued.and_then(|(node, _)| self.names.get(node)) {
            return Ok((*id, true));
        }
        let shown = Token::Word(name).shown();
        Err(if self.open.contains(&name) {
            Fault::new(
                at,
                "a node that does not contain itself",
                format!("USE {shown} inside the definition of {shown}: a cycle"),
                "take the instance out of its own body",
            )
        } else {
            Fault::new(
                at,
                "a name given by DEF further up in this file",
                shown,
                "define the node before its first use, or correct the name",
            )
        })
    }

    /// A node after its type name `word`: the braces and what is in them.
    pub(super) fn node_of_type(
        &mut self,
        word: &'t str,
        at: usize,
        name: Option<&'t str>,
    ) -> Result<NodeId, Fault> {
        self.expect_mark(
            b'{',
            &format!("`{{` after the node type `{word}`"),
            "write the node as `Type { … }`",
        )?;
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(Fault::new(
                at,
                format!("at most {MAX_DEPTH} nodes nested in one another"),
                "one more",
                "flatten the file: groups without effect can be left out",
            ));
        }
        let spec = schema::find(word, self.vrml97);
        let kind = spec.map_or(Kind::Other, |spec| spec.kind);
        let mut node = Node { kind, at, name: name.map(Box::from), fields: Vec::new(), children: Vec::new() };
        self.body(word, spec, &mut node)?;
        self.depth -= 1;
        if node.kind == Kind::Other && node.nodes("alternateRep").is_empty() {
            self.skip(word.to_owned());
        }
        if node.numbers("transparency").is_some_and(|shares| shares.iter().any(|share| *share > 0.0)) {
            self.skip(format!("{word}.transparency (read as opaque)"));
        }
        let id = self.nodes.len() as NodeId;
        self.nodes.push(node);
        Ok(id)
    }

    fn body(&mut self, word: &'t str, mut spec: Option<&'static Spec>, node: &mut Node) -> Result<(), Fault> {
        loop {
            let (token, at) = self.lexer.peek()?;
            match token {
                Token::Mark(b'}') => {
                    self.lexer.take()?;
                    return Ok(());
                }
                Token::Word("DEF" | "USE") => node.children.push(self.node()?),
                Token::Word(field) if self.statement97(field)? => {}
                Token::Word(field) if is_type_name(field) => {
                    self.lexer.take()?;
                    let form = spec.and_then(|spec| spec.fields.iter().find(|(name, _)| *name == field));
                    match (form, self.lexer.peek_byte()) {
                        (Some((name, form)), _) => match self.field(name, *form, word)? {
                            Some(Value::Nodes(nodes)) if *form == Form::Nodes => node.children.extend(nodes),
                            Some(value) => node.fields.push((name, value)),
                            None => {}
                        },
                        (None, Some(b'{')) => node.children.push(self.node_of_type(field, at, None)?),
                        (None, Some(b'[')) if matches!(field, "fields" | "isA" | "inputs" | "outputs") => {
                            let names = self.word_list(field)?;
                            if field == "isA" && spec.is_none() {
                                // The first ancestor type that is known here stands in for the unknown type.
                                spec = names.iter().find_map(|name| schema::find(name, self.vrml97));
                                node.kind = spec.map_or(Kind::Other, |spec| spec.kind);
                            }
                        }
                        (None, _) if field == "alternateRep" => {
                            let value = self.field("alternateRep", Form::Node, word)?;
                            node.fields.extend(value.map(|value| ("alternateRep", value)));
                        }
                        (None, _) => {
                            self.unknown_field(field)?;
                            if spec.is_some() {
                                self.skip(format!("{word}.{field}"));
                            }
                        }
                    }
                }
                other => {
                    return Err(Fault::new(
                        at,
                        format!("a field or child of `{word}`, or `}}` to end it"),
                        other.shown(),
                        "check the braces and brackets before this place",
                    ));
                }
            }
        }
    }

    /// A list of bare or quoted words in brackets, such as the `fields [ SFFloat x ]` of self-describing
    /// nodes.
    pub(super) fn word_list(&mut self, what: &str) -> Result<Vec<String>, Fault> {
        self.expect_mark(b'[', &format!("`[` after `{what}`"), "write the list in brackets")?;
        let mut words = Vec::new();
        loop {
            match self.lexer.take()? {
                (Token::Mark(b']'), _) => return Ok(words),
                (Token::Word(word), _) => words.push(word.to_owned()),
                (Token::Text(text), _) => words.push(text.into_owned()),
                (token, at) => {
                    return Err(Fault::new(
                        at,
                        format!("a word, or `]` to end the list after `{what}`"),
                        token.shown(),
                        "close the list",
                    ));
                }
            }
        }
    }

    /// Takes the mark or fails.
    pub(super) fn expect_mark(&mut self, mark: u8, expected: &str, remedy: &str) -> Result<(), Fault> {
        match self.lexer.take()? {
            (Token::Mark(found), _) if found == mark => Ok(()),
            (token, at) => Err(Fault::new(at, expected, token.shown(), remedy)),
        }
    }

    pub(super) fn skip(&mut self, what: String) {
        *self.skipped.entry(what).or_default() += 1;
    }
}

/// Whether a word can name a node type or a field.
pub(super) fn is_type_name(word: &str) -> bool {
    word.starts_with(|c: char| c.is_alphabetic() || c == '_') && word != "NULL"
}

pub(super) fn no_node(token: &Token, at: usize) -> Fault {
    Fault::new(
        at,
        "a node (`Type { … }`, DEF or USE)",
        token.shown(),
        "remove it, or write a node in its place",
    )
}
