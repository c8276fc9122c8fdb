//! Solids to draw: tools, arrows, a scale and a floor.

use palpate::math::{Pose, Vec3};
use palpate::solver::tool::{Shape, ToolDesc};

use super::colour::{Colour, STEEL};
use super::raster::{Kind, Mesh, Vertex};

/// Steps around a round solid.
const ROUND: usize = 48;

/// The parts of a tool at a pose.
pub fn tool(desc: &ToolDesc, pose: &Pose) -> Vec<Mesh> {
    desc.parts.iter().map(|(part, shape)| convex(shape, &(pose * part), STEEL)).collect()
}

/// A shape. Each of them is a ball swept over a smaller core (a point, a segment, a box), so that the point with a given normal
/// is the core's corner in that direction plus the ball's radius along the normal.
fn convex(shape: &Shape, pose: &Pose, colour: Colour) -> Mesh {
    let (core, radius_m) = match *shape {
        Shape::Sphere { radius_m } => (Vec3::zeros(), radius_m),
        Shape::Capsule { radius_m, half_length_m } => (Vec3::z() * half_length_m, radius_m),
        Shape::Box { half_extents_m, rounding_m } => (half_extents_m.map(|h| h - rounding_m), rounding_m),
    };
    let rows = ROUND / 2;
    let mut vertices = Vec::with_capacity((rows + 1) * ROUND);
    for row in 0..=rows {
        for column in 0..ROUND {
            let (down, around) = (
                row as f64 / rows as f64 * std::f64::consts::PI,
                (column as f64 + 0.5) / ROUND as f64 * std::f64::consts::TAU,
            );
            let normal = Vec3::new(down.sin() * around.cos(), down.sin() * around.sin(), down.cos());
            let corner = core.zip_map(&normal, |edge, side| edge * side.signum());
            let position = pose.transform_point(&(corner + normal * radius_m).into()).coords;
            vertices.push(Vertex { position, normal: pose.rotation * normal, colour });
        }
    }

    // The first and the last ring of a box go around its upper and its lower side, which a fan fills.
    let mut triangles = grid(rows, ROUND);
    for (ring, side) in [(0, 1.0), (rows * ROUND, -1.0)] {
        let position = pose.transform_point(&(Vec3::z() * (side * (core.z + radius_m))).into()).coords;
        let middle = vertices.len() as u32;
        vertices.push(Vertex { position, normal: pose.rotation * Vec3::z() * side, colour });
        triangles.extend((0..ROUND).map(|c| [middle, (ring + c) as u32, (ring + (c + 1) % ROUND) as u32]));
    }
    Mesh { kind: Kind::Solid, vertices, triangles, has_shadow: true }
}

/// An arrow from a point along a vector, of that vector's length.
pub fn arrow(from: Vec3, vector: Vec3, radius_m: f64, colour: Colour) -> Mesh {
    let length = vector.norm();
    let along = vector / length;
    let head = (4.5 * radius_m).min(0.6 * length);
    // Rings as (distance along the arrow, radius, lean of the normal along the arrow).
    let rings: [(f64, f64, f64); 8] = [
        (0.0, 0.0, -1.0),
        (0.0, radius_m, -1.0),
        (0.0, radius_m, 0.0),
        (length - head, radius_m, 0.0),
        (length - head, radius_m, -1.0),
        (length - head, 2.4 * radius_m, -1.0),
        (length - head, 2.4 * radius_m, 0.45),
        (length, 0.0, 0.45),
    ];
    let side = along.cross(&Vec3::ith(along.iamin(), 1.0)).normalize();
    let other = along.cross(&side);
    let mut vertices = Vec::new();
    for (distance, radius, lean) in rings {
        for column in 0..ROUND {
            let angle = column as f64 / ROUND as f64 * std::f64::consts::TAU;
            let out = side * angle.cos() + other * angle.sin();
            let normal = (out * (1.0 - lean * lean).sqrt() + along * lean).normalize();
            vertices.push(Vertex { position: from + along * distance + out * radius, normal, colour });
        }
    }
    Mesh { kind: Kind::Solid, vertices, triangles: grid(rings.len() - 1, ROUND), has_shadow: true }
}

/// A flat bar on the floor, `pieces` pieces of `piece_m` in turn dark and light, from `from` along `along`.
pub fn scale(from: Vec3, along: Vec3, up: Vec3, piece_m: f64, pieces: u8) -> Mesh {
    let across = up.cross(&along) * 0.004;
    let mut mesh = Mesh { kind: Kind::Solid, vertices: Vec::new(), triangles: Vec::new(), has_shadow: false };
    for piece in 0..pieces {
        let colour = if piece % 2 == 0 { [0.02; 3] } else { [0.85; 3] };
        let start = from + along * (f64::from(piece) * piece_m) + up * 0.0004;
        let corners = [start, start + along * piece_m, start + along * piece_m + across, start + across];
        quad(&mut mesh, corners, up, colour);
    }
    mesh
}

/// A square of floor around `centre`, which shows shadows only.
pub fn floor(centre: Vec3, up: Vec3, half_m: f64) -> Mesh {
    let side = up.cross(&Vec3::ith(up.iamin(), 1.0)).normalize() * half_m;
    let other = up.cross(&side);
    let corners =
        [centre - side - other, centre + side - other, centre + side + other, centre - side + other];
    let mut mesh = Mesh { kind: Kind::Floor, vertices: Vec::new(), triangles: Vec::new(), has_shadow: false };
    quad(&mut mesh, corners, up, [0.0; 3]);
    mesh
}

fn quad(mesh: &mut Mesh, corners: [Vec3; 4], normal: Vec3, colour: Colour) {
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend(corners.map(|position| Vertex { position, normal, colour }));
    mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
}

/// Triangles between `rows + 1` closed rings of `columns` vertices.
fn grid(rows: usize, columns: usize) -> Vec<[u32; 3]> {
    let vertex = |row: usize, column: usize| (row * columns + column % columns) as u32;
    let squares = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
    squares
        .flat_map(|(row, column)| {
            let [a, b] = [vertex(row, column), vertex(row, column + 1)];
            let [c, d] = [vertex(row + 1, column), vertex(row + 1, column + 1)];
            [[a, c, d], [a, d, b]]
        })
        .collect()
}
