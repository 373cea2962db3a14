//! A parsed file: nodes in one arena, children by index, so that instancing (`USE`) is sharing and dropping
//! never recurses.
//!
//! Invariant: the graph has no cycle, because a name stands for its node only after the node's body has
//! ended.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::rc::Rc;

use glam::DVec3;

use super::schema::Kind;
use crate::scene::read::place::line_and_column;

/// Index of a node in its document.
pub type NodeId = u32;

/// One file, parsed.
#[derive(Debug)]
pub struct Document {
    /// Where it was read from; includes are sought beside it.
    pub path: PathBuf,
    /// The text, kept for line numbers in messages.
    pub text: String,
    /// Whether this is VRML97, whose groups and transforms scope their children.
    pub vrml97: bool,
    /// All nodes; a node stands after its children.
    pub nodes: Vec<Node>,
    /// The nodes at top level, in order.
    pub roots: Vec<NodeId>,
    /// Node and field types that were parsed but not interpreted, with how often they occur.
    pub skipped: BTreeMap<String, u64>,
}

/// A node with the fields its schema names.
#[derive(Debug)]
pub struct Node {
    /// What it does.
    pub kind: Kind,
    /// Byte offset of its type name.
    pub at: usize,
    /// Its `DEF` name.
    pub name: Option<Box<str>>,
    /// Fields as written; a later one overrides an earlier one of the same name.
    pub fields: Vec<(&'static str, Value)>,
    /// Children, in order.
    pub children: Vec<NodeId>,
}

/// A field's value.
#[derive(Clone, Debug)]
pub enum Value {
    /// Numbers, integers, flags as 0 and 1; shared, so that taking them into the traversal state costs
    /// nothing.
    Numbers(Rc<[f64]>),
    /// Words of an enumeration.
    Words(Vec<&'static str>),
    /// Strings.
    Strings(Vec<String>),
    /// Nodes.
    Nodes(Vec<NodeId>),
    /// Flagged `~`: the node leaves this property of the traversal state alone.
    Ignored,
}

impl Document {
    /// `file:line:column` of byte `at`.
    pub fn place(&self, at: usize) -> String {
        let (line, column) = line_and_column(&self.text, at);
        format!("{}:{line}:{column}", self.path.display())
    }
}

impl Node {
    /// The field called `name`, if it is written.
    pub fn field(&self, name: &str) -> Option<&Value> {
        self.fields.iter().rev().find(|(field, _)| *field == name).map(|(_, value)| value)
    }

    /// Whether the field is flagged as ignored.
    pub fn ignores(&self, name: &str) -> bool {
        matches!(self.field(name), Some(Value::Ignored))
    }

    /// All numbers of a field, if it is written.
    pub fn numbers(&self, name: &str) -> Option<&Rc<[f64]>> {
        match self.field(name)? {
            Value::Numbers(numbers) => Some(numbers),
            _ => None,
        }
    }

    /// A single number.
    pub fn number(&self, name: &str, default: f64) -> f64 {
        self.numbers(name).and_then(|numbers| numbers.first().copied()).unwrap_or(default)
    }

    /// A single integer.
    pub fn integer(&self, name: &str, default: i64) -> i64 {
        self.number(name, default as f64) as i64
    }

    /// A flag.
    pub fn flag(&self, name: &str, default: bool) -> bool {
        self.number(name, f64::from(u8::from(default))) != 0.0
    }

    /// Three numbers as a vector.
    pub fn vector(&self, name: &str, default: DVec3) -> DVec3 {
        self.numbers(name).and_then(|n| n.get(..3)).map_or(default, DVec3::from_slice)
    }

    /// The one word of an enumeration.
    pub fn word(&self, name: &str, default: &'static str) -> &'static str {
        match self.field(name) {
            Some(Value::Words(words)) => words.first().copied().unwrap_or(default),
            _ => default,
        }
    }

    /// Whether the bit mask `name` (all bits when not written) holds `bit` or `ALL`.
    pub fn has_bit(&self, name: &str, bit: &str) -> bool {
        match self.field(name) {
            Some(Value::Words(words)) => words.iter().any(|word| *word == bit || *word == "ALL"),
            _ => true,
        }
    }

    /// The strings of a field.
    pub fn strings(&self, name: &str) -> &[String] {
        match self.field(name) {
            Some(Value::Strings(strings)) => strings,
            _ => &[],
        }
    }

    /// The nodes of a field.
    pub fn nodes(&self, name: &str) -> &[NodeId] {
        match self.field(name) {
            Some(Value::Nodes(nodes)) => nodes,
            _ => &[],
        }
    }
}
