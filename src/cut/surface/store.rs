//! Things by numbers that stay while others come and go.

use std::ops::{Index, IndexMut};

/// No number of a thing.
pub const NONE: u32 = u32::MAX;

/// Things by their numbers.
#[derive(Clone, Debug)]
pub struct Store<T> {
    things: Vec<Option<T>>,
    free: Vec<u32>,
    left: Vec<u32>,
}

impl<T> Default for Store<T> {
    fn default() -> Self {
        Self { things: Vec::new(), free: Vec::new(), left: Vec::new() }
    }
}

impl<T> Store<T> {
    /// How many numbers have been given.
    pub fn len(&self) -> usize {
        self.things.len()
    }

    /// Whether there is a thing of a number.
    pub fn has(&self, n: u32) -> bool {
        self.things.get(n as usize).is_some_and(Option::is_some)
    }

    /// Adds a thing.
    pub fn insert(&mut self, thing: T) -> u32 {
        match self.free.pop() {
            Some(n) => {
                self.things[n as usize] = Some(thing);
                n
            }
            None => {
                self.things.push(Some(thing));
                self.things.len() as u32 - 1
            }
        }
    }

    /// Takes a thing away. Its number is not given again before [`Self::settle`].
    pub fn remove(&mut self, n: u32) -> T {
        self.left.push(n);
        self.things[n as usize].take().expect("what is removed is there")
    }

    /// Lets numbers of what has been removed be given again.
    pub fn settle(&mut self) {
        self.free.append(&mut self.left);
    }
}

impl<T> Index<u32> for Store<T> {
    type Output = T;

    fn index(&self, n: u32) -> &T {
        self.things[n as usize].as_ref().expect("what is asked for is there")
    }
}

impl<T> IndexMut<u32> for Store<T> {
    fn index_mut(&mut self, n: u32) -> &mut T {
        self.things[n as usize].as_mut().expect("what is asked for is there")
    }
}
