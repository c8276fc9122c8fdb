//! The body from outside, whole or cut open, with the tool, the force on it, and a scale on the floor.

use palpate::math::Vec3;

use super::super::snapshot::Snapshot;
use super::drawing::camera::{Camera, Window};
use super::drawing::canvas::{Anchor, Canvas, INK};
use super::drawing::colour::{Colour, FORCE, of_quantity, to_srgb};
use super::drawing::light::Light;
use super::drawing::raster::{Kind, Mesh, Plane, Raster, Vertex};
use super::drawing::solid;
use super::slice::Slice;
use super::{
    HEIGHT, Lying, Subject, Tint, WIDTH, headline, legend, material_colour, millimetres, round_length,
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
    let (mut canvas, seen) = picture(subject, snapshot, skin(subject, snapshot, tint), None, view)?;

    let what =
        if tint == Tint::Material { "From outside, by tissue" } else { "From outside, by displacement" };
    headline(&mut canvas, subject, snapshot, what);
    legend(&mut canvas, subject.model, tint, seen);
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
    let (mut canvas, seen) = picture(subject, snapshot, meshes, Some(slice.plane), view)?;

    headline(&mut canvas, subject, snapshot, "Cut open at the tool, by tissue");
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

/// The picture without its headline, and which materials can be seen in it.
fn picture(
    subject: &Subject,
    snapshot: &Snapshot,
    mut meshes: Vec<Mesh>,
    cut: Option<Plane>,
    view: Vec3,
) -> anyhow::Result<(Canvas, [bool; 16])> {
    let lying = Lying::new(subject.direction);
    let body = Body::new(&subject.before.positions, &lying);
    let scale = Scale::new(&body, &lying, cut);
    let points = points_to_see(subject, &scale, cut);
    let window = Window { left: 40.0, top: 190.0, width: 2260.0, height: 1540.0 };
    let camera = Camera::perspective(view, lying.up, &points, window);

    // Solids.
    let force_n = snapshot.wrench.force_n;
    let arrow =
        (force_n.norm() > 1e-6).then(|| (rear(subject, snapshot, 0.004), force_n.normalize() * ARROW_M));
    meshes.extend(solid::tool(&subject.tool.desc, &snapshot.tool));
    meshes.extend(arrow.map(|(from, along)| solid::arrow(from, along, 0.0022, FORCE)));
    meshes.push(solid::floor(body.floor_centre, lying.up, 1.1 * body.size_m));
    meshes.push(solid::scale(scale.from, scale.along, lying.up, scale.piece_m, PIECES));

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
    if let Some((from, along)) = arrow {
        let ([x, y], ink) = (place(from + along), FORCE.map(to_srgb));
        let text = format!("{:.2} N on the tool", force_n.norm());
        canvas.text(&text, [x + 16.0, y + 14.0], 18.0, Anchor::Start, ink);
    }
    let [x, y] = place(scale.from + scale.along * (0.5 * scale.length_m()));
    canvas.text(&millimetres(scale.length_m()), [x, y + 28.0], 15.0, Anchor::Middle, INK);
    Ok((canvas, seen_materials(&raster, subject)))
}

/// The rear end of the tool, or a point behind it.
fn rear(subject: &Subject, snapshot: &Snapshot, beyond_m: f64) -> Vec3 {
    snapshot.tool.translation.vector - subject.direction * (subject.tool.rear_m + beyond_m)
}

/// What the camera has to see: the body, the scale, and the tool where it starts. The same for all moments of a press, so that
/// pictures can be compared.
fn points_to_see(subject: &Subject, scale: &Scale, cut: Option<Plane>) -> Vec<Vec3> {
    let is_kept = |p: &&Vec3| cut.is_none_or(|plane| plane.distance(**p) <= 0.01);
    let mut points: Vec<Vec3> = subject.before.positions.iter().filter(is_kept).copied().collect();
    points.extend([rear(subject, subject.before, 0.0), rear(subject, subject.pressed, 1.15 * ARROW_M)]);
    points.extend([scale.from, scale.from + scale.along * scale.length_m()]);
    points
}

/// Materials whose pure colour is on the picture.
fn seen_materials(raster: &Raster, subject: &Subject) -> [bool; 16] {
    let palette: [Colour; 16] = std::array::from_fn(|m| material_colour(subject.model, m as u8));
    let mut seen = [false; 16];
    for pixel in raster.pixels.iter().filter(|pixel| matches!(pixel.kind, Kind::Tissue | Kind::Cut)) {
        let is_near = |colour: &Colour| (0..3).all(|c| (colour[c] - pixel.colour[c]).abs() < 1e-4);
        if let Some(material) = palette.iter().position(is_near) {
            seen[material] = true;
        }
    }
    seen
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
}

/// A scale on the floor.
struct Scale {
    from: Vec3,
    along: Vec3,
    piece_m: f64,
}

impl Scale {
    /// Along the body, or along the cut.
    fn new(body: &Body, lying: &Lying, cut: Option<Plane>) -> Self {
        let piece_m = round_length(0.05 * body.size_m);
        let half_m = 0.5 * piece_m * f64::from(PIECES);
        let half_width_m = (body.high - body.low).component_mul(&lying.side).abs().sum() / 2.0;
        let (middle, along) = match cut {
            None => (body.floor_centre + lying.side * (half_width_m + GAP_M), -lying.head),
            Some(plane) => {
                let away = (plane.normal - lying.up * plane.normal.dot(&lying.up)).normalize();
                let way_m = plane.distance(body.floor_centre) / plane.normal.dot(&away);
                (body.floor_centre + away * (GAP_M - way_m), -lying.side)
            }
        };
        Self { from: middle - along * half_m, along, piece_m }
    }

    fn length_m(&self) -> f64 {
        self.piece_m * f64::from(PIECES)
    }
}
