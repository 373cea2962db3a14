//! Sets of CPU (or node) numbers of any size, read and written as the kernel does: `0-3,8`.
//!
//! Invariant: no trailing zero word, so that equal sets compare equal.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::error::Error;

/// Bits per word.
const WORD: usize = u64::BITS as usize;

/// The largest number accepted from text, so that a typing error cannot ask for terabytes.
const MAX_NUMBER: usize = 1 << 20;

/// A set of operating-system CPU or node numbers; it grows as needed, 1024 is no limit.
#[derive(Clone, Default, PartialEq, Eq, Hash)]
pub struct CpuSet {
    words: Vec<u64>,
}

impl CpuSet {
    /// The empty set.
    pub const fn new() -> Self {
        Self { words: Vec::new() }
    }

    /// From the kernel's words, least significant bit first.
    pub fn from_words(mut words: Vec<u64>) -> Self {
        while words.last() == Some(&0) {
            words.pop();
        }
        Self { words }
    }

    /// The words, least significant bit first, without trailing zeros.
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// Adds a number.
    pub fn insert(&mut self, number: usize) {
        let word = number / WORD;
        if word >= self.words.len() {
            self.words.resize(word + 1, 0);
        }
        self.words[word] |= 1 << (number % WORD);
    }

    /// Whether the number is in the set.
    pub fn contains(&self, number: usize) -> bool {
        self.words.get(number / WORD).is_some_and(|word| word >> (number % WORD) & 1 == 1)
    }

    /// How many numbers are in the set.
    pub fn len(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Whether nothing is in the set.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// The numbers in both sets.
    pub fn intersection(&self, other: &Self) -> Self {
        Self::from_words(self.words.iter().zip(&other.words).map(|(a, b)| a & b).collect())
    }

    /// The numbers, ascending.
    pub fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        self.words.iter().enumerate().flat_map(|(index, &word)| {
            (0..WORD).filter(move |bit| word >> bit & 1 == 1).map(move |bit| index * WORD + bit)
        })
    }
}

impl FromIterator<usize> for CpuSet {
    fn from_iter<I: IntoIterator<Item = usize>>(numbers: I) -> Self {
        let mut set = Self::new();
        numbers.into_iter().for_each(|number| set.insert(number));
        set
    }
}

/// Reads `0-3,8` as a list that keeps its order, for callers to whom the order matters.
pub fn parse_list(text: &str) -> Result<Vec<usize>, Error> {
    let mut list = Vec::new();
    for piece in text.trim().split(',').map(str::trim).filter(|piece| !piece.is_empty()) {
        let bad = || Error::CpuList { text: text.to_owned(), found: piece.to_owned() };
        let number = |part: &str| {
            part.trim().parse::<usize>().ok().filter(|&number| number <= MAX_NUMBER).ok_or_else(bad)
        };
        match piece.split_once('-') {
            Some((first, last)) => {
                let (first, last) = (number(first)?, number(last)?);
                if first > last {
                    return Err(bad());
                }
                list.extend(first..=last);
            }
            None => list.push(number(piece)?),
        }
    }
    Ok(list)
}

impl FromStr for CpuSet {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        Ok(parse_list(text)?.into_iter().collect())
    }
}

impl fmt::Display for CpuSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut numbers = self.iter().peekable();
        let mut separator = "";
        while let Some(first) = numbers.next() {
            let mut last = first;
            while let Some(next) = numbers.next_if_eq(&(last + 1)) {
                last = next;
            }
            match last - first {
                0 => write!(f, "{separator}{first}")?,
                _ => write!(f, "{separator}{first}-{last}")?,
            }
            separator = ",";
        }
        if separator.is_empty() { f.write_str("none") } else { Ok(()) }
    }
}

impl fmt::Debug for CpuSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{{{self}}}")
    }
}

impl Serialize for CpuSet {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn bad_lists_are_named() {
        for text in ["a", "1-", "3-1", "-2", "1,,x", "99999999999999999999", "0-99999999"] {
            let error = text.parse::<CpuSet>().expect_err(text).to_string();
            assert!(error.contains(text), "{error}");
        }
        assert!(" ".parse::<CpuSet>().unwrap().is_empty());
    }

    #[test]
    fn lists_keep_their_order() {
        assert_eq!(parse_list("4, 0-2").unwrap(), [4, 0, 1, 2]);
    }

    proptest! {
        #[test]
        fn text_round_trips(numbers in proptest::collection::btree_set(0usize..5000, 0..60)) {
            let set: CpuSet = numbers.iter().copied().collect();
            prop_assert_eq!(set.len(), numbers.len());
            prop_assert!(set.iter().eq(numbers.iter().copied()));
            if !numbers.is_empty() {
                prop_assert_eq!(set.to_string().parse::<CpuSet>().unwrap(), set);
            }
        }

        #[test]
        fn intersection_is_both(a in proptest::collection::btree_set(0usize..300, 0..60),
                                b in proptest::collection::btree_set(0usize..300, 0..60)) {
            let both = a.iter().copied().collect::<CpuSet>().intersection(&b.iter().copied().collect());
            prop_assert_eq!(both, a.intersection(&b).copied().collect());
        }
    }
}
