//! Triangles by numbers that stay.

use super::hash::Map;

/// A triangle that is not there.
const GONE: [u32; 3] = [0; 3];

/// A list of triangles to which a change is made.
#[derive(Debug)]
pub struct Numbers<'a> {
    all: &'a mut Vec<[u32; 3]>,
    free: &'a mut Vec<u32>,
    before: Map<u32, [u32; 3]>,
}

impl<'a> Numbers<'a> {
    /// Of all triangles, of which some numbers are free.
    pub fn new(all: &'a mut Vec<[u32; 3]>, free: &'a mut Vec<u32>) -> Self {
        Self { all, free, before: Map::default() }
    }

    /// Makes a number one of a triangle.
    pub fn put(&mut self, n: u32, triangle: [u32; 3]) {
        let place = &mut self.all[n as usize];
        self.before.entry(n).or_insert(*place);
        *place = triangle;
    }

    /// Takes the triangle of a number away, which stays reserved.
    pub fn empty(&mut self, n: u32) {
        self.put(n, GONE);
    }

    /// Takes the triangle of a number away.
    pub fn release(&mut self, n: u32) {
        self.empty(n);
        self.free.push(n);
    }

    /// A number that is free.
    pub fn take(&mut self) -> u32 {
        self.free.pop().unwrap_or_else(|| {
            let n = self.all.len() as u32;
            self.all.push(GONE);
            self.before.insert(n, GONE);
            n
        })
    }

    /// The numbers whose triangles are others now, ascending.
    pub fn changed(self) -> Vec<u32> {
        let is_other = |(n, before): (u32, [u32; 3])| (self.all[n as usize] != before).then_some(n);
        let mut changed: Vec<u32> = self.before.into_iter().filter_map(is_other).collect();
        changed.sort_unstable();
        changed
    }
}
