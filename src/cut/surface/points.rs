//! The points that parts of a surface and of walls have for corners.

use super::hash::Map;
use super::store::Store;
use crate::math::Vec3;

/// What a point is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Name {
    /// A vertex of the surface.
    Outer(u32),
    /// A point of a wall.
    Wall(u32),
    /// Where an edge of the surface passes a wall's triangle.
    OuterEdge([u32; 2], u32),
    /// Where a wall's edge passes a triangle of the surface.
    WallEdge([u32; 2], u32),
}

/// A point that parts have for a corner.
#[derive(Clone, Debug)]
pub struct Point {
    /// What it is.
    pub name: Name,
    /// Where it is at rest, m.
    pub at: Vec3,
    /// Texture coordinates on the surface.
    pub uv: [f32; 2],
    /// Texture coordinates on walls.
    pub wall_uv: [f32; 2],
    /// The half edges that start from it.
    pub corners: Vec<u32>,
    /// The vertices there, one for each side.
    pub vertices: Vec<u32>,
}

/// Points by their numbers.
#[derive(Clone, Debug, Default)]
pub struct Points {
    all: Store<Point>,
    numbers: Map<Name, u32>,
    /// Those that have been looked for of late.
    asked: Vec<u32>,
}

impl Points {
    /// The number of a point, which is made where there is none.
    pub fn number(&mut self, name: Name, new: impl FnOnce() -> (Vec3, [f32; 2], [f32; 2])) -> u32 {
        let Self { all, numbers, asked } = self;
        *numbers.entry(name).or_insert_with(|| {
            let (at, uv, wall_uv) = new();
            let vertices = match name {
                Name::Outer(v) => vec![v],
                _ => Vec::new(),
            };
            let n = all.insert(Point { name, at, uv, wall_uv, corners: Vec::new(), vertices });
            asked.push(n);
            n
        })
    }

    /// A point.
    pub fn get(&self, n: u32) -> &Point {
        &self.all[n]
    }

    /// A point, to be changed.
    pub fn get_mut(&mut self, n: u32) -> &mut Point {
        &mut self.all[n]
    }

    /// Removes those of some points, and of those that were made since the last time, which are no part's corners.
    pub fn drop_unused(&mut self, touched: &[u32]) {
        for n in std::mem::take(&mut self.asked).into_iter().chain(touched.iter().copied()) {
            if self.all.has(n) && self.all[n].corners.is_empty() {
                let point = self.all.remove(n);
                self.numbers.remove(&point.name);
            }
        }
        self.all.settle();
    }
}
