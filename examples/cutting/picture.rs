//! The tissue at one moment, with the walls of its cut and the blade.

use palpate::math::{Pose, Quat, Vec3};
use palpate::sim::SurfaceFrame;
use palpate::solver::tool::{Shape, ToolDesc};

use super::drawing::camera::{Camera, Window};
use super::drawing::canvas::{Anchor, Canvas, INK};
use super::drawing::colour::{Colour, of_material, to_linear};
use super::drawing::light::Light;
use super::drawing::raster::{Kind, Mesh, Raster, Vertex};
use super::drawing::solid;
use super::scene::{GRASPER_M, Scene, View};

/// Size of the pictures in pixels.
pub const SIZE: [usize; 2] = [1400, 1050];
/// Half the thickness at which the edge is drawn, in m.
const EDGE_M: f64 = 6e-4;
/// What was laid open, in sRGB.
const WALL: [u8; 3] = [150, 36, 38];

/// The surface at one moment.
#[derive(Clone, Debug)]
pub struct Moment {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    materials: Vec<u8>,
    triangles: Vec<[u32; 3]>,
    first_wall: usize,
    blade: Option<Pose>,
    grasper: Option<Vec3>,
    time_s: f64,
}

impl Moment {
    /// What a frame shows, with the blade and the grasper where they are there.
    pub fn of(frame: &SurfaceFrame<'_>, blade: Option<&Pose>, grasper: Option<Vec3>) -> Self {
        let vector = |v: &[f32; 4]| Vec3::new(v[0].into(), v[1].into(), v[2].into());
        Self {
            positions: frame.positions.iter().map(vector).collect(),
            normals: frame.normals.iter().map(vector).collect(),
            materials: frame.materials.to_vec(),
            triangles: frame.triangles.to_vec(),
            first_wall: frame.first_wall,
            blade: blade.copied(),
            grasper,
            time_s: frame.time_s,
        }
    }

    fn meshes(&self, scene: &Scene) -> Vec<Mesh> {
        let colours: Vec<Colour> = (1..)
            .zip(scene.model.materials())
            .map(|(index, material)| of_material(&material.name, index))
            .collect();
        let part = |triangles: &[[u32; 3]], colour: &dyn Fn(usize) -> Colour| Mesh {
            kind: Kind::Tissue,
            vertices: (0..self.positions.len())
                .map(|v| Vertex { position: self.positions[v], normal: self.normals[v], colour: colour(v) })
                .collect(),
            triangles: triangles.to_vec(),
            has_shadow: true,
        };
        let of_tissue = |v: usize| colours[usize::from(self.materials[v]) - 1];
        // Walls are tissue laid open: its colour, reddened.
        let wall = WALL.map(to_linear);
        let of_wall = |v: usize| {
            let tissue = of_tissue(v);
            std::array::from_fn(|c| 0.35 * tissue[c] + 0.65 * wall[c])
        };
        let (outer, walls) = self.triangles.split_at(self.first_wall);
        let mut meshes = vec![part(outer, &of_tissue), part(walls, &of_wall)];
        if let Some(pose) = &self.blade {
            meshes.extend(solid::tool(&rod(&scene.blade.edge), pose));
        }
        if let Some(at) = self.grasper {
            let tip = ToolDesc::sphere(GRASPER_M);
            meshes.extend(solid::tool(&tip, &Pose::translation(at.x, at.y, at.z)));
        }
        meshes
    }
}

/// An edge as thin rods.
fn rod(edge: &[Vec3]) -> ToolDesc {
    let part = |ends: &[Vec3]| {
        let way = ends[1] - ends[0];
        let turn = Quat::rotation_between(&Vec3::z(), &way)
            .unwrap_or_else(|| Quat::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI));
        let pose = Pose::from_parts((0.5 * (ends[0] + ends[1])).into(), turn);
        (pose, Shape::Capsule { radius_m: EDGE_M, half_length_m: 0.5 * way.norm() })
    };
    ToolDesc { parts: edge.windows(2).map(part).collect(), friction: 0.0, blade: None }
}

/// Draws a moment. `bounds` are moments that all must fit in with, so that pictures compare.
pub fn draw(
    (scene, view): (&Scene, &View),
    moment: &Moment,
    bounds: &[Moment],
    [width, height]: [usize; 2],
) -> anyhow::Result<Canvas> {
    let bodies: Vec<Vec3> = bounds.iter().flat_map(|moment| &moment.positions).copied().collect();
    let meshes = moment.meshes(scene);
    let (w, h) = (2.0 * width as f64, 2.0 * height as f64);
    let window = Window { left: 0.06 * w, top: 0.14 * h, width: 0.88 * w, height: 0.80 * h };
    let camera = Camera::perspective(view.back, view.up, &bodies, window);
    let mut raster = Raster::new(2 * width, 2 * height);
    meshes.iter().for_each(|mesh| raster.draw(&camera, mesh, None));
    let light = Light::new(&camera, view.up, &meshes, None, &bodies);
    let mut canvas = Canvas::from_light(&light.shine(&raster, &camera), width, height)?;
    let size = 0.024 * height as f32;
    canvas.text(view.title, [1.4 * size, 2.0 * size], size, Anchor::Start, INK);
    let words = format!("{:.2} s", moment.time_s);
    canvas.text(&words, [1.4 * size, 3.3 * size], 0.75 * size, Anchor::Start, INK);
    Ok(canvas)
}
