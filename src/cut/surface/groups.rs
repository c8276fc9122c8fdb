//! Which of some things are connected.

/// Numbers in groups that only ever grow together.
pub struct Groups(Vec<u32>);

impl Groups {
    /// Numbers from 0, each on its own.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// Makes the groups of two numbers one.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// The lowest number in a number's group.
    pub fn of(&mut self, mut n: u32) -> u32 {
        while self.0[n as usize] != n {
            self.0[n as usize] = self.0[self.0[n as usize] as usize];
            n = self.0[n as usize];
        }
        n
    }

    /// The lowest number in the group of each.
    pub fn all(mut self) -> Vec<u32> {
        (0..self.0.len() as u32).map(|n| self.of(n)).collect()
    }
}
