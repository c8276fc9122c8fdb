//! The triangles around each vertex of a surface, where triangles may come and go.

use crate::error::{Error, Result};
use crate::model::surface::grow;

/// Numbers in lists that nobody uses before all lists are moved together, besides as many as are used.
const LOOSE: usize = 256;

/// For each vertex the triangles at it, ascending. Lists lie in one array, with gaps where they have been other ones.
#[derive(Clone, Debug, Default)]
pub struct Fans {
    /// Where each vertex's list starts and ends.
    spans: Vec<[u32; 2]>,
    /// Where the room for it ends.
    rooms: Vec<u32>,
    triangles: Vec<u32>,
    /// How many numbers the lists have together.
    used: usize,
}

impl Fans {
    /// Of the triangles of a surface with so many vertices. A triangle that names a vertex twice stands twice in its list; one that names the same vertex three times is nowhere.
    pub fn new(vertices: usize, triangles: &[[u32; 3]]) -> Result<Self> {
        if triangles.len() > (u32::MAX / 6) as usize {
            return Err(Error::Limit(format!("a mesh of {} triangles is too large", triangles.len())));
        }
        let there = || (0..).zip(triangles).filter(|(_, triangle)| is_there(triangle));
        let mut ends = vec![0_u32; vertices];
        for &v in there().flat_map(|(_, triangle)| triangle) {
            ends[v as usize] += 1;
        }
        let mut used = 0;
        let spans = ends.iter_mut().map(|end| {
            let start = used;
            used += *end;
            *end = start;
            start
        });
        let starts: Vec<u32> = spans.collect();
        let mut all = vec![0; used as usize];
        for (t, corners) in there() {
            for &v in corners {
                all[ends[v as usize] as usize] = t;
                ends[v as usize] += 1;
            }
        }
        let spans = starts.into_iter().zip(&ends).map(|(start, &end)| [start, end]).collect();
        Ok(Self { spans, rooms: ends, triangles: all, used: used as usize })
    }

    /// The triangles at a vertex, ascending.
    pub fn at(&self, vertex: usize) -> &[u32] {
        let [start, end] = self.spans[vertex];
        &self.triangles[start as usize..end as usize]
    }

    /// Where lists start and end in [`Self::lists`], vertex by vertex.
    pub fn spans(&self) -> &[[u32; 2]] {
        &self.spans
    }

    /// All lists.
    pub fn lists(&self) -> &[u32] {
        &self.triangles
    }

    /// There are so many vertices now; new ones have no triangles.
    pub fn resize(&mut self, vertices: usize) {
        self.spans.resize(vertices, [0; 2]);
        self.rooms.resize(vertices, 0);
    }

    /// Makes room for the lists of so many vertices and triangles in all.
    pub fn reserve(&mut self, vertices: usize, triangles: usize) {
        grow(&mut self.spans, vertices);
        grow(&mut self.rooms, vertices);
        grow(&mut self.triangles, Self::room(3 * triangles));
    }

    /// Gives a vertex another list.
    pub fn set(&mut self, vertex: usize, list: &[u32]) {
        self.used = self.used - self.at(vertex).len() + list.len();
        let start = self.spans[vertex][0] as usize;
        let start = if start + list.len() <= self.rooms[vertex] as usize {
            self.triangles[start..start + list.len()].copy_from_slice(list);
            start
        } else {
            let start = self.triangles.len();
            self.triangles.extend_from_slice(list);
            // Room for two more: what a cut divides is divided again before long.
            self.triangles.extend([0; 2]);
            self.rooms[vertex] = self.triangles.len() as u32;
            start
        };
        self.spans[vertex] = [start, start + list.len()].map(|at| at as u32);
    }

    /// Moves all lists together if more lies between them than they are; returns whether it did.
    pub fn tidy(&mut self) -> bool {
        if self.triangles.len() <= Self::room(self.used) {
            return false;
        }
        let mut all = Vec::with_capacity(self.used);
        for (span, room) in self.spans.iter_mut().zip(&mut self.rooms) {
            let start = all.len() as u32;
            all.extend_from_slice(&self.triangles[span[0] as usize..span[1] as usize]);
            *room = all.len() as u32;
            *span = [start, *room];
        }
        self.triangles = all;
        true
    }

    /// Most numbers in [`Self::lists`], after [`Self::tidy`], of lists with so many numbers.
    pub fn room(used: usize) -> usize {
        2 * used + LOOSE
    }
}

/// Whether a triangle is one: surfaces that change keep places for those that come.
pub fn is_there([a, b, c]: &[u32; 3]) -> bool {
    a != b || b != c
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Noise;

    #[test]
    fn lists_that_change_are_those_of_the_triangles_that_are_left_and_take_no_more_room_than_promised() {
        let (vertices, mut noise) = (200, Noise(3));
        let mut number = |n: usize| ((noise.next().abs() * n as f64) as usize).min(n - 1);
        // Some vertices have many triangles.
        let triangle = |number: &mut dyn FnMut(usize) -> usize| {
            [0; 3].map(|_: u32| {
                let most = number(vertices) + 1;
                number(most) as u32
            })
        };
        let mut triangles: Vec<[u32; 3]> = (0..450).map(|_| triangle(&mut number)).collect();
        let mut fans = Fans::new(vertices, &triangles).unwrap();
        let mut has_tidied = false;
        for _ in 0..5000 {
            let t = number(triangles.len());
            let old = std::mem::replace(
                &mut triangles[t],
                if number(3) == 0 { [0; 3] } else { triangle(&mut number) },
            );
            let expected = Fans::new(vertices, &triangles).unwrap();
            for v in old.into_iter().chain(triangles[t]) {
                fans.set(v as usize, expected.at(v as usize));
            }
            has_tidied |= fans.tidy();
            assert!(fans.lists().len() <= Fans::room(expected.lists().len()));
            assert!((0..vertices).all(|v| fans.at(v) == expected.at(v)));
        }
        assert!(has_tidied, "what is left behind by lists is taken back");
    }
}
