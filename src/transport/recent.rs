//! What a worker made lately for cells of packets: elements of a receiver look at the same cells one after the other, tens of times.

use std::fmt::{Debug, Formatter};

use crate::math::Cell;
use crate::math::chance::mix;

/// How many values of a kind a worker remembers.
pub(super) const REMEMBERED: usize = 1024;

/// What a value is known by: the packet, the cell, and a number of its own.
pub(super) type Key = (u64, Cell, usize);

/// Places, each of which remembers the last of the values that belong there.
pub struct Recent<V>(Vec<Option<(Key, V)>>);

impl<V> Recent<V> {
    /// The value of this key. One that is not remembered is made, perhaps out of the one that is forgotten for it.
    pub(super) fn get(&mut self, key: Key, make: impl FnOnce(Option<V>) -> V) -> &V {
        if self.0.is_empty() {
            self.0.resize_with(REMEMBERED, || None);
        }
        let place = &mut self.0[place(&key)];
        let other = place.take_if(|(known, _)| *known != key).map(|(_, value)| value);
        &place.get_or_insert_with(|| (key, make(other))).1
    }
}

/// Where a value belongs.
fn place((packet, cell, number): &Key) -> usize {
    let parts = [cell.low.x, cell.low.y, cell.size.x, cell.size.y].map(f64::to_bits);
    let hash = parts.into_iter().fold(mix(*packet, *number as u64), mix);
    hash as usize % REMEMBERED
}

impl<V> Default for Recent<V> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<V> Debug for Recent<V> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recent").finish_non_exhaustive()
    }
}
