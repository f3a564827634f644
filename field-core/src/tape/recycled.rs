//! Memory of a list whose items borrow, kept without them.

use alloc::vec::Vec;

/// An empty list that only carries capacity over from one tape to the next. It names no type of items, only their layout: two
/// words, as of a reference to a trait object.
#[derive(Default)]
pub(super) struct Recycled(Vec<[usize; 2]>);

impl Recycled {
    /// An empty list of references to trait objects, in the memory of the last.
    pub(super) fn take<'a, T: ?Sized>(&mut self) -> Vec<&'a T> {
        empty(core::mem::take(&mut self.0))
    }

    /// Keep the memory of a list.
    pub(super) fn give<T: ?Sized>(&mut self, list: Vec<&T>) {
        self.0 = empty(list);
    }
}

impl Clone for Recycled {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl core::fmt::Debug for Recycled {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("[]")
    }
}

/// Same allocation, other items: collecting an emptied list into one of the same layout reuses its memory.
fn empty<A, B>(mut list: Vec<A>) -> Vec<B> {
    list.clear();
    list.into_iter().map_while(|_| None).collect()
}
