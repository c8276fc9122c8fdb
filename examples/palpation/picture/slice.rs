//! A flat section through the tool, across the body, true to scale: the deformed cells, the tool, and where its surface was before.

use palpate::math::Vec3;
use palpate::model::Model;

use super::drawing::camera::{Camera, Window};
use super::drawing::canvas::{Anchor, Canvas, INK};
use super::drawing::colour::{Colour, FORCE, STEEL, of_quantity, to_linear, to_srgb};
use super::drawing::raster::{Kind, Mesh, Plane, Raster, Vertex};
use super::drawing::solid;
use super::section::{self, CellCut};
use super::{
    HEIGHT, Lying, Subject, Tint, WIDTH, headline, legend, material_colour, millimetres, round_length,
    side_name,
};

/// Length of the force arrow in metres.
const ARROW_M: f64 = 0.03;
/// Cells smaller than this many pixels are drawn without their edges.
const EDGE_PIXELS: f64 = 5.0;

/// The plane and what it cuts.
#[derive(Debug)]
pub struct Slice {
    /// The plane; its normal points to the feet.
    pub plane: Plane,
    cells: Vec<CellCut>,
}

impl Slice {
    /// The section of the pressed body through the tool's axis.
    pub fn new(subject: &Subject) -> Self {
        let lying = Lying::new(subject.direction);
        // The plane holds the tool's axis even where that is oblique to the body's.
        let normal = (-lying.head + subject.direction * lying.head.dot(&subject.direction)).normalize();
        let plane = Plane { normal, offset: normal.dot(&subject.pressed.tool.translation.vector) };
        let cells = section::cut(subject.model, &subject.pressed.node_displacements, plane);
        Self { plane, cells }
    }

    /// Strain of each cut cell.
    pub fn strains(&self) -> impl Iterator<Item = f32> {
        self.cells.iter().map(|cell| cell.strain)
    }

    /// Corners and their colours.
    pub fn triangles(&self, model: &Model, tint: Tint) -> impl Iterator<Item = ([Vec3; 3], [Colour; 3])> {
        let palette: [Colour; 16] = std::array::from_fn(|m| material_colour(model, m as u8));
        self.cells.iter().flat_map(move |cell| {
            cell.triangles.iter().map(move |corners| {
                let colours = corners.map(|corner| match tint {
                    Tint::Material => palette[usize::from(cell.material) % 16],
                    Tint::Displacement(top_m) => of_quantity(corner.displacement_m / top_m),
                    Tint::Strain(top) => of_quantity(cell.strain / top),
                });
                (corners.map(|corner| corner.position), colours)
            })
        })
    }

    /// The picture.
    pub fn draw(&self, subject: &Subject, tint: Tint) -> anyhow::Result<Canvas> {
        let lying = Lying::new(subject.direction);
        let camera = self.camera(subject, lying.up);
        let place = |point: Vec3| {
            let [x, y, _] = camera.project(point);
            [x as f32 / 2.0, y as f32 / 2.0]
        };
        let mut canvas = self.areas(subject.model, tint, &camera)?;

        // Edges of cells, and the surface before the press.
        let cell_pixels = subject.model.lattice().cell_m() * camera.pixels_per_metre(1.0) / 2.0;
        if cell_pixels >= EDGE_PIXELS {
            let edges = self.cells.iter().flat_map(|cell| &cell.outline).map(|edge| edge.map(place));
            canvas.lines(&edges.collect::<Vec<_>>(), 0.6, [30, 20, 20], 70);
        }
        let before = contour(&subject.before.positions, &subject.before.triangles, self.plane);
        canvas.lines(
            &before.into_iter().map(|line| line.map(place)).collect::<Vec<_>>(),
            1.6,
            [20, 90, 200],
            230,
        );

        self.tool(&mut canvas, subject, &place);
        self.words(&mut canvas, subject, tint, &camera);
        Ok(canvas)
    }

    fn camera(&self, subject: &Subject, up: Vec3) -> Camera {
        let corners = self.cells.iter().flat_map(|cell| cell.triangles.iter().flatten());
        let mut points: Vec<Vec3> = corners.map(|corner| corner.position).collect();
        let pressed = subject.pressed;
        points.push(
            pressed.tool.translation.vector - subject.direction * (subject.tool.rear_m + 1.2 * ARROW_M),
        );
        let window = Window { left: 150.0, top: 210.0, width: 2060.0, height: 1430.0 };
        Camera::parallel(self.plane.normal, up, &points, window)
    }

    fn areas(&self, model: &Model, tint: Tint, camera: &Camera) -> anyhow::Result<Canvas> {
        let mut mesh =
            Mesh { kind: Kind::Cut, vertices: Vec::new(), triangles: Vec::new(), has_shadow: false };
        for (corners, colours) in self.triangles(model, tint) {
            let first = mesh.vertices.len() as u32;
            mesh.triangles.push([first, first + 1, first + 2]);
            let normal = self.plane.normal;
            mesh.vertices.extend((0..3).map(|c| Vertex { position: corners[c], normal, colour: colours[c] }));
        }
        let mut raster = Raster::new(2 * WIDTH, 2 * HEIGHT);
        raster.draw(camera, &mesh, None);
        let paper = [247, 248, 249].map(to_linear);
        let flat =
            raster.pixels.iter().map(|pixel| if pixel.kind == Kind::Empty { paper } else { pixel.colour });
        Canvas::from_light(&flat.collect::<Vec<_>>(), WIDTH, HEIGHT)
    }

    fn tool(&self, canvas: &mut Canvas, subject: &Subject, place: &dyn Fn(Vec3) -> [f32; 2]) {
        for part in solid::tool(&subject.tool.desc, &subject.pressed.tool).into_iter().rev() {
            let positions: Vec<Vec3> = part.vertices.iter().map(|vertex| vertex.position).collect();
            let mut hull =
                hull(contour(&positions, &part.triangles, self.plane).into_iter().flatten().map(place));
            canvas.polygon(&hull, STEEL.map(to_srgb), 255);
            if let Some(&first) = hull.first() {
                hull.push(first);
            }
            let rim: Vec<[[f32; 2]; 2]> = hull.windows(2).map(|pair| [pair[0], pair[1]]).collect();
            canvas.lines(&rim, 1.4, INK, 255);
        }

        let force_n = subject.pressed.wrench.force_n;
        if force_n.norm() > 1e-6 {
            let from =
                subject.pressed.tool.translation.vector - subject.direction * (subject.tool.rear_m + 0.004);
            let to = place(from + force_n.normalize() * ARROW_M);
            let ink = FORCE.map(to_srgb);
            canvas.arrow(place(from), to, 5.0, ink);
            let text = format!("{:.2} N on the tool", force_n.norm());
            canvas.text(&text, [to[0] + 16.0, to[1] + 16.0], 18.0, Anchor::Start, ink);
        }
    }

    fn words(&self, canvas: &mut Canvas, subject: &Subject, tint: Tint, camera: &Camera) {
        let what = match tint {
            Tint::Material => "Section through the tool, by tissue",
            Tint::Displacement(_) => "Section through the tool, by displacement",
            Tint::Strain(_) => "Section through the tool, by strain",
        };
        headline(canvas, subject, subject.pressed, what);
        let seen = std::array::from_fn(|m| self.cells.iter().any(|cell| usize::from(cell.material) == m));
        legend(canvas, subject.model, tint, seen);

        let [x, y] = [super::LEGEND_X, 790.0];
        canvas.lines(&[[[x, y], [x + 22.0, y]]], 1.6, [20, 90, 200], 230);
        canvas.text("surface before", [x + 30.0, y + 5.0], 15.0, Anchor::Start, INK);

        let length_m = round_length(0.25 * WIDTH as f64 / (camera.pixels_per_metre(1.0) / 2.0) / 1.6);
        let length = (length_m * camera.pixels_per_metre(1.0) / 2.0) as f32;
        canvas.scale_bar([75.0, 868.0], length, &millimetres(length_m));

        let grey = [120, 124, 130];
        let middle = [(75.0 + 1105.0) / 2.0, 870.0];
        canvas.text(side_name(-camera.up), middle, 15.0, Anchor::Middle, grey);
        canvas.text(side_name(-camera.right), [22.0, 480.0], 15.0, Anchor::Start, grey);
        canvas.text(side_name(camera.right), [1122.0, 480.0], 15.0, Anchor::Start, grey);
    }
}

/// Where a plane crosses a surface.
fn contour(positions: &[Vec3], triangles: &[[u32; 3]], plane: Plane) -> Vec<[Vec3; 2]> {
    let mut lines = Vec::new();
    for triangle in triangles {
        let corners = triangle.map(|v| positions[v as usize]);
        let sides = corners.map(|corner| plane.distance(corner));
        let ends: Vec<Vec3> = (0..3)
            .map(|a| (a, (a + 1) % 3))
            .filter(|&(a, b)| (sides[a] < 0.0) != (sides[b] < 0.0))
            .map(|(a, b)| corners[a].lerp(&corners[b], sides[a] / (sides[a] - sides[b])))
            .collect();
        if let [from, to] = ends[..] {
            lines.push([from, to]);
        }
    }
    lines
}

/// The convex polygon around points, as two chains from left to right.
fn hull(points: impl Iterator<Item = [f32; 2]>) -> Vec<[f32; 2]> {
    let mut points: Vec<[f32; 2]> = points.collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let chain = |points: &mut dyn Iterator<Item = [f32; 2]>| {
        let mut chain: Vec<[f32; 2]> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut polygon = chain(&mut points.iter().copied());
    polygon.extend(chain(&mut points.iter().rev().copied()));
    polygon
}
