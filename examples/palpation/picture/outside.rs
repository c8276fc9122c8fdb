//! The body from outside, whole or cut open, with the tool, the force on it, and a scale on the floor.

use palpate::math::Vec3;

use super::super::snapshot::Snapshot;
use super::camera::{Camera, Window};
use super::canvas::{Anchor, Canvas, INK};
use super::colour::{Colour, FORCE, of_quantity};
use super::light::Light;
use super::raster::{Kind, Mesh, Plane, Raster, Vertex};
use super::slice::Slice;
use super::{
    HEIGHT, Lying, Subject, Tint, WIDTH, headline, legend, material_colour, millimetres, round_length, solid,
};

/// Length of the force arrow in metres.
const ARROW_M: f64 = 0.035;
/// Pieces of the scale on the floor.
const PIECES: u8 = 5;
/// Floor between the body and the scale, in metres.
const GAP_M: f64 = 0.02;

/// The whole body at one moment.
pub fn whole(subject: &Subject, snapshot: &Snapshot, tint: Tint) -> anyhow::Result<Canvas> {
    let lying = Lying::new(subject.direction);
    let view = lying.side * 0.75 + lying.up * 0.62 - lying.head * 0.42;
    let mut canvas = picture(subject, snapshot, skin(subject, snapshot, tint), None, view)?;

    let what =
        if tint == Tint::Material { "From outside, by tissue" } else { "From outside, by displacement" };
    headline(&mut canvas, subject, snapshot, what);
    legend(&mut canvas, subject.model, tint, snapshot.materials.iter().copied());
    Ok(canvas)
}

/// The pressed body without the part between the tool and the viewer at its feet.
pub fn cut_open(subject: &Subject, slice: &Slice) -> anyhow::Result<Canvas> {
    let lying = Lying::new(subject.direction);
    let view = lying.up * 0.42 + lying.side * 0.30 - lying.head * 0.85;
    let snapshot = subject.pressed;

    let mut mesh = Mesh { kind: Kind::Cut, vertices: Vec::new(), triangles: Vec::new(), has_shadow: false };
    for (corners, colour) in slice.triangles(subject.model, Tint::Material) {
        let first = mesh.vertices.len() as u32;
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.vertices.extend(corners.map(|position| Vertex {
            position,
            normal: slice.plane.normal,
            colour: colour[0],
        }));
    }
    let mut meshes = skin(subject, snapshot, Tint::Material);
    meshes.push(mesh);
    let mut canvas = picture(subject, snapshot, meshes, Some(slice.plane), view)?;

    headline(&mut canvas, subject, snapshot, "Cut open at the tool, by tissue");
    let seen = snapshot.materials.iter().copied().chain(slice.materials());
    legend(&mut canvas, subject.model, Tint::Material, seen);
    Ok(canvas)
}

/// The surface of the tissue.
fn skin(subject: &Subject, snapshot: &Snapshot, tint: Tint) -> Vec<Mesh> {
    let palette: [Colour; 16] = std::array::from_fn(|m| material_colour(subject.model, m as u8));
    let colour = |vertex: usize| match tint {
        Tint::Displacement(top_m) => of_quantity(snapshot.displacements_m[vertex] / top_m),
        Tint::Material | Tint::Strain(_) => palette[usize::from(snapshot.materials[vertex]) % 16],
    };
    let vertex =
        |v: usize| Vertex { position: snapshot.positions[v], normal: snapshot.normals[v], colour: colour(v) };
    let vertices = (0..snapshot.positions.len()).map(vertex).collect();
    vec![Mesh { kind: Kind::Tissue, vertices, triangles: snapshot.triangles.clone(), has_shadow: true }]
}

fn picture(
    subject: &Subject,
    snapshot: &Snapshot,
    mut meshes: Vec<Mesh>,
    cut: Option<Plane>,
    view: Vec3,
) -> anyhow::Result<Canvas> {
    let lying = Lying::new(subject.direction);
    let body = Body::new(&subject.before.positions, &lying);

    // All pictures of a press have the same camera: it sees the body, and the tool where it starts.
    let rear = |s: &Snapshot, beyond: f64| {
        s.tool.translation.vector - subject.direction * (subject.tool.rear_m + beyond)
    };
    let is_kept = |p: &&Vec3| cut.is_none_or(|plane| plane.distance(**p) <= 0.01);
    let mut points: Vec<Vec3> = subject.before.positions.iter().filter(is_kept).copied().collect();
    points.extend([rear(subject.before, 0.0), rear(subject.pressed, 1.15 * ARROW_M)]);
    let piece_m = round_length(0.05 * body.size_m);
    let length_m = piece_m * f64::from(PIECES);
    let (scale_from, scale_along) = body.scale(&lying, cut, length_m);
    points.extend([scale_from, scale_from + scale_along * length_m]);
    let window = Window { left: 40.0, top: 190.0, width: 2260.0, height: 1540.0 };
    let camera = Camera::perspective(view, lying.up, &points, window);

    // Solids.
    meshes.extend(solid::tool(&subject.tool.desc, &snapshot.tool));
    let force_n = snapshot.wrench.force_n;
    let arrow_end = (force_n.norm() > 1e-6).then(|| {
        let (from, along) = (rear(snapshot, 0.004), force_n.normalize() * ARROW_M);
        meshes.push(solid::arrow(from, along, 0.0022, FORCE));
        from + along
    });
    meshes.push(solid::floor(body.floor_centre, lying.up, 1.1 * body.size_m));
    meshes.push(solid::scale(scale_from, scale_along, lying.up, piece_m, PIECES));

    // Light and pixels.
    let mut raster = Raster::new(2 * WIDTH, 2 * HEIGHT);
    meshes.iter().for_each(|mesh| raster.draw(&camera, mesh, cut));
    let light = Light::new(&camera, lying.up, &meshes, cut, &points);
    let mut canvas = Canvas::from_light(&light.shine(&raster, &camera), WIDTH, HEIGHT)?;

    // Words.
    let place = |point: Vec3| {
        let [x, y, _] = camera.project(point);
        [x as f32 / 2.0, y as f32 / 2.0]
    };
    if let Some(end) = arrow_end {
        let [x, y] = place(end);
        let ink = FORCE.map(super::colour::to_srgb);
        canvas.text(
            &format!("{:.2} N on the tool", force_n.norm()),
            [x + 16.0, y + 14.0],
            18.0,
            Anchor::Start,
            ink,
        );
    }
    let [x, y] = place(scale_from + scale_along * (0.5 * length_m));
    canvas.text(&millimetres(length_m), [x, y + 28.0], 15.0, Anchor::Middle, INK);
    Ok(canvas)
}

/// The extent of a body.
struct Body {
    low: Vec3,
    high: Vec3,
    size_m: f64,
    floor_centre: Vec3,
}

impl Body {
    fn new(positions: &[Vec3], lying: &Lying) -> Self {
        let start = (Vec3::repeat(f64::MAX), Vec3::repeat(f64::MIN));
        let (low, high) = positions.iter().fold(start, |(low, high), p| (low.inf(p), high.sup(p)));
        let middle = (low + high) / 2.0;
        let drop = (high - low).component_mul(&lying.up).abs().sum() / 2.0 + 0.0005;
        Self { low, high, size_m: (high - low).norm(), floor_centre: middle - lying.up * drop }
    }

    /// Where a scale of `length_m` starts and where it goes: on the floor, along the body or along the cut.
    fn scale(&self, lying: &Lying, cut: Option<Plane>, length_m: f64) -> (Vec3, Vec3) {
        let beside =
            lying.side * ((self.high - self.low).component_mul(&lying.side).abs().sum() / 2.0 + GAP_M);
        match cut {
            None => (self.floor_centre + beside + lying.head * (0.5 * length_m), -lying.head),
            Some(plane) => {
                let below_cut = self.floor_centre - plane.normal * plane.distance(self.floor_centre);
                (below_cut + plane.normal * GAP_M + lying.side * (0.5 * length_m), -lying.side)
            }
        }
    }
}
