//! What a change of a cut surface changes in what is shown of it.

use super::arrange::Scene;
use super::glue::{Joint, Part, Place};
use super::grid::{GridNode, cells_around};
use super::hang::{Hanger, Hung};
use super::hash::Set;
use super::numbers::Numbers;
use super::store::NONE;
use super::{Body, Change, CutSurface, Replaced, State, SurfaceChange, Tie, Touched};
use crate::math::Vec3;
use crate::model::surface::{Row, Surface};

/// Where a vertex is, and its texture coordinates on the surface and on walls.
#[derive(Clone, Copy, Debug)]
struct Spot {
    at: Vec3,
    uv: [f32; 2],
    wall_uv: [f32; 2],
}

impl Spot {
    /// In the middle of others.
    fn middle(spots: &[Self]) -> Self {
        let share = 1.0 / spots.len() as f64;
        let mean = |of: fn(&Self) -> [f32; 2]| {
            [0, 1].map(|i| (share * spots.iter().map(|spot| f64::from(of(spot)[i])).sum::<f64>()) as f32)
        };
        let at = spots.iter().map(|spot| spot.at).sum::<Vec3>() * share;
        Self { at, uv: mean(|spot| spot.uv), wall_uv: mean(|spot| spot.wall_uv) }
    }
}

impl State {
    fn spot(&self, surface: &Surface, v: u32) -> Spot {
        let middle = |of: &[u32]| {
            let spots: Vec<Spot> = of.iter().map(|&v| self.spot(surface, v)).collect();
            Spot::middle(&spots)
        };
        match self.mesh.vertex(v).map(|vertex| vertex.place) {
            None => {
                let v = v as usize;
                Spot { at: surface.positions[v], uv: surface.uvs[v], wall_uv: [0.0; 2] }
            }
            Some(Place::Point(point)) => {
                let point = self.points.get(point);
                Spot { at: point.at, uv: point.uv, wall_uv: point.wall_uv }
            }
            Some(Place::Edge(ends)) => middle(&ends),
            Some(Place::Face(corners)) => middle(&corners),
        }
    }

    /// The vertices of the original, and then the new ones, that may hang on other nodes than before, ascending.
    fn loose(&self, change: &Change, touched: &Touched, replaced: &Replaced, joint: &Joint) -> [Vec<u32>; 2] {
        let mut cells: Set<GridNode> = touched.nodes.iter().flat_map(|&node| cells_around(node)).collect();
        let mut loose = joint.vertices.clone();
        for w in cells.iter().flat_map(|&cell| self.walls.in_cell(cell)) {
            for side in 0..2 {
                let faces = self.mesh.faces_of(Part::Wall((*w, side)));
                loose.extend(faces.iter().flat_map(|&face| self.mesh.faces[face].all_vertices()));
            }
        }
        cells.extend(replaced.cells.iter().copied());
        loose.extend(cells.iter().flat_map(|&cell| self.index.vertices_in(cell)));
        for slot in change.cells.iter().chain(&change.rehung) {
            loose.extend(self.index.vertices_on(*slot));
            loose.extend(self.hosted.get(slot).into_iter().flatten());
        }
        let (mut outer, mut new): (Vec<u32>, Vec<u32>) =
            loose.into_iter().partition(|&v| (v as usize) < self.mesh.outer_vertex_count());
        new.retain(|&v| self.mesh.vertex(v).is_some());
        outer.sort_unstable();
        new.sort_unstable();
        [outer, new]
    }

    /// Notes what a vertex hangs on.
    fn host(&mut self, v: u32, host: u32) {
        let before = std::mem::replace(&mut self.hosts[v as usize], host);
        if before == host {
            return;
        }
        if let Some(vertices) = self.hosted.get_mut(&before) {
            vertices.retain(|&other| other != v);
        }
        if host != NONE {
            self.hosted.entry(host).or_default().push(v);
        }
    }
}

impl CutSurface {
    /// Shows what has changed. Nothing is shown of it where that fails.
    pub(super) fn show(
        &mut self,
        body: Body<'_>,
        change: &Change,
        touched: &Touched,
        replaced: &Replaced,
        joint: &Joint,
        outer: &[u32],
    ) -> Result<SurfaceChange, Tie> {
        let Body { surface, lattice, topology } = body;
        let state = &self.state;
        let hanger = Hanger { lattice, topology, grid: &state.grid, walls: &state.walls };
        let scene = Scene { surface, walls: &state.walls, cell_m: lattice.cell_m(), seed: state.seed };
        let [loose, new] = state.loose(change, touched, replaced, joint);
        let mut rehung = Vec::with_capacity(loose.len());
        for v in loose {
            let n = v as usize;
            let hung = hanger.rehung(&surface.rows[n], surface.positions[n], scene.vertex_beside(v))?;
            rehung.push((v, hung));
        }
        let mut hung = Vec::with_capacity(new.len());
        for v in new {
            let spot = state.spot(surface, v);
            let anchor = state.mesh.vertex(v).expect("only those that are there are loose").anchor;
            hung.push((v, spot, hanger.on_piece(anchor, spot.at).ok_or(Tie)?));
        }

        let mut changed = SurfaceChange { looked_at: rehung.len() + hung.len(), ..SurfaceChange::default() };
        for (v, now) in rehung {
            let n = v as usize;
            let (row, material) =
                now.map_or((surface.rows[n], surface.materials[n]), |hung| (hung.row, hung.material));
            if self.hang(v, row, material) {
                changed.vertices.push(v);
            }
            self.state.host(v, now.map_or(NONE, |hung| hung.host));
        }
        self.make_room(surface);
        for (v, Spot { at, uv, wall_uv }, Hung { row, material, host }) in hung {
            let n = v as usize;
            let is_moved = (self.positions[n], self.uvs[n], self.wall_uvs[n]) != (at, uv, wall_uv);
            (self.positions[n], self.uvs[n], self.wall_uvs[n]) = (at, uv, wall_uv);
            if self.hang(v, row, material) || is_moved {
                changed.vertices.push(v);
            }
            self.state.host(v, host);
        }
        (changed.triangles, changed.walls) = self.number(surface, joint, outer);
        Ok(changed)
    }

    /// Room for all vertices.
    fn make_room(&mut self, surface: &Surface) {
        let count = self.state.mesh.vertex_count().max(self.positions.len());
        self.positions.resize(count, Vec3::zeros());
        self.uvs.resize(count, [0.0; 2]);
        self.wall_uvs.resize(count, [0.0; 2]);
        self.materials.resize(count, 0);
        self.rows.resize(count, surface.rows[0]);
        self.state.hosts.resize(count, NONE);
    }

    /// Hangs a vertex on nodes; returns whether they are others than before.
    fn hang(&mut self, v: u32, row: Row, material: u8) -> bool {
        let n = v as usize;
        let before = (self.rows[n].nodes, self.rows[n].weights, self.materials[n]);
        (self.rows[n], self.materials[n]) = (row, material);
        before != (row.nodes, row.weights, material)
    }

    /// Gives triangles their numbers; returns those of the outer surface and of walls that have changed. The triangles of the original surface that were looked at are `outer`.
    fn number(&mut self, surface: &Surface, joint: &Joint, outer: &[u32]) -> (Vec<u32>, Vec<u32>) {
        let [free, free_walls] = &mut self.state.free;
        let mut triangles = Numbers::new(&mut self.triangles, free);
        let mut walls = Numbers::new(&mut self.walls, free_walls);
        for &(part, slot) in &joint.slots {
            match part {
                // What a triangle of the original is divided into may have its number, and nothing else.
                Part::Outer(t) if t == slot => triangles.empty(t),
                Part::Outer(_) => triangles.release(slot),
                Part::Wall(_) => walls.release(slot),
            }
        }
        let mesh = &mut self.state.mesh;
        let mut faces: Vec<u32> = joint.faces.iter().copied().collect();
        faces.sort_unstable();
        for face in faces {
            let part = mesh.faces[face].part;
            let own = match part {
                Part::Outer(t) => Some(t)
                    .filter(|t| !mesh.faces_of(part).iter().any(|&face| mesh.faces[face].slots.contains(t))),
                Part::Wall(_) => None,
            };
            let list = if matches!(part, Part::Outer(_)) { &mut triangles } else { &mut walls };
            let now = mesh.faces[face].triangles();
            let slots = &mut mesh.faces[face].slots;
            if slots.is_empty() {
                slots.extend(own);
            }
            while slots.len() < now.len() {
                slots.push(list.take());
            }
            for slot in slots.drain(now.len()..) {
                list.release(slot);
            }
            for (&slot, triangle) in slots.iter().zip(now) {
                list.put(slot, triangle);
            }
        }
        for &t in outer {
            if mesh.faces_of(Part::Outer(t)).is_empty() {
                triangles.put(t, surface.triangles[t as usize]);
            }
        }
        (triangles.changed(), walls.changed())
    }
}
