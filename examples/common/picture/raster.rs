//! Triangles to pixels: a depth buffer that also keeps the normal and the colour of the nearest surface.

use std::num::NonZero;

use palpate::math::Vec3;

use super::camera::Camera;
use super::colour::Colour;

/// What a pixel shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Nothing.
    #[default]
    Empty,
    /// The floor, which only shows shadows.
    Floor,
    /// Tissue from outside.
    Tissue,
    /// A cut through tissue.
    Cut,
    /// A tool, an arrow, a scale.
    Solid,
}

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    /// World position.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Colour without light.
    pub colour: Colour,
}

/// Triangles of one kind.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// What they are.
    pub kind: Kind,
    /// Corners.
    pub vertices: Vec<Vertex>,
    /// Indices of corners.
    pub triangles: Vec<[u32; 3]>,
    /// Whether it throws a shadow.
    pub has_shadow: bool,
}

/// Half of space: the points with `normal · x > offset` are cut away.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    /// Unit normal.
    pub normal: Vec3,
    /// Distance of the plane from the origin along the normal.
    pub offset: f64,
}

impl Plane {
    /// Signed distance, positive on the side that is cut away.
    pub fn distance(&self, point: Vec3) -> f64 {
        self.normal.dot(&point) - self.offset
    }
}

/// One pixel before light.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    /// Distance in front of the camera.
    pub depth: f32,
    /// Normal as stored at the corners.
    pub normal: [f32; 3],
    /// Colour without light.
    pub colour: Colour,
    /// What is seen.
    pub kind: Kind,
}

/// A picture before light.
#[derive(Clone, Debug)]
pub struct Raster {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height × width]`.
    pub pixels: Vec<Pixel>,
}

impl Raster {
    /// A picture of nothing.
    pub fn new(width: usize, height: usize) -> Self {
        let empty = Pixel { depth: f32::INFINITY, normal: [0.0; 3], colour: [0.0; 3], kind: Kind::Empty };
        Self { width, height, pixels: vec![empty; width * height] }
    }

    /// Draws a mesh; of tissue, only what `cut` leaves.
    pub fn draw(&mut self, camera: &Camera, mesh: &Mesh, cut: Option<Plane>) {
        let cut = cut.filter(|_| mesh.kind == Kind::Tissue);
        let corners: Vec<Corner> =
            mesh.vertices.iter().map(|vertex| Corner::new(camera, vertex, cut)).collect();
        let width = self.width;
        in_bands(&mut self.pixels, width, |first_row, band| {
            for triangle in &mesh.triangles {
                fill(band, width, first_row, triangle.map(|v| &corners[v as usize]), camera, mesh.kind);
            }
        });
    }
}

/// Runs `work` on horizontal bands of `rows` of `width` elements, one band for each core.
pub fn in_bands<T: Send>(rows: &mut [T], width: usize, work: impl Fn(usize, &mut [T]) + Sync) {
    let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
    let band_rows = (rows.len() / width).div_ceil(cores).max(1);
    std::thread::scope(|scope| {
        for (band, rows) in rows.chunks_mut(band_rows * width).enumerate() {
            let work = &work;
            scope.spawn(move || work(band * band_rows, rows));
        }
    });
}

/// A corner on the picture.
struct Corner {
    x: f64,
    y: f64,
    depth: f64,
    /// Signed distance to the cut plane.
    beyond: f64,
    normal: Vec3,
    colour: Colour,
}

impl Corner {
    fn new(camera: &Camera, vertex: &Vertex, cut: Option<Plane>) -> Self {
        let [x, y, depth] = camera.project(vertex.position);
        let beyond = cut.map_or(-1.0, |plane| plane.distance(vertex.position));
        Self { x, y, depth, beyond, normal: vertex.normal, colour: vertex.colour }
    }
}

/// Fills one triangle into the rows of one band.
fn fill(
    band: &mut [Pixel],
    width: usize,
    first_row: usize,
    [a, b, c]: [&Corner; 3],
    camera: &Camera,
    kind: Kind,
) {
    let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    let is_hidden =
        (a.beyond > 0.0 && b.beyond > 0.0 && c.beyond > 0.0) || a.depth.min(b.depth).min(c.depth) <= 1e-4;
    if area.abs() < 1e-12 || is_hidden {
        return;
    }

    // Pixels whose centres may be inside.
    let rows = band.len() / width;
    let span = |p: f64, q: f64, r: f64, from: usize, count: usize| {
        let low = (p.min(q).min(r) - 0.5).ceil().max(from as f64) as usize;
        let high = ((p.max(q).max(r) - 0.5).floor() + 1.0).clamp(0.0, (from + count) as f64) as usize;
        low..high
    };
    let columns = span(a.x, b.x, c.x, 0, width);

    for row in span(a.y, b.y, c.y, first_row, rows) {
        for column in columns.clone() {
            let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
            let wb = ((x - a.x) * (c.y - a.y) - (y - a.y) * (c.x - a.x)) / area;
            let wc = ((b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)) / area;
            let wa = 1.0 - wb - wc;
            if wa < 0.0 || wb < 0.0 || wc < 0.0 {
                continue;
            }

            // In perspective, what is linear on a triangle is linear on the picture after division by depth.
            let (wa, wb, wc, depth) = if camera.is_parallel() {
                (wa, wb, wc, wa * a.depth + wb * b.depth + wc * c.depth)
            } else {
                let (ua, ub, uc) = (wa / a.depth, wb / b.depth, wc / c.depth);
                let depth = 1.0 / (ua + ub + uc);
                (ua * depth, ub * depth, uc * depth, depth)
            };
            let pixel = &mut band[(row - first_row) * width + column];
            if depth as f32 >= pixel.depth || wa * a.beyond + wb * b.beyond + wc * c.beyond > 0.0 {
                continue;
            }
            let normal = a.normal * wa + b.normal * wb + c.normal * wc;
            let mix = |k: usize| a.colour[k] * wa as f32 + b.colour[k] * wb as f32 + c.colour[k] * wc as f32;
            *pixel = Pixel {
                depth: depth as f32,
                normal: [normal.x as f32, normal.y as f32, normal.z as f32],
                colour: std::array::from_fn(mix),
                kind,
            };
        }
    }
}
