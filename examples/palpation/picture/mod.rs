//! The pictures: which there are, and what they have in common.

#[path = "../../common/picture/mod.rs"]
mod drawing;
mod outside;
mod section;
mod slice;

use std::path::Path;

use indicatif::ProgressBar;
use palpate::math::Vec3;
use palpate::model::Model;

use self::drawing::canvas::{Anchor, Canvas, INK};
use self::drawing::colour::{self, Colour};
use super::snapshot::Snapshot;
use super::tool::Tool;

/// Width of every picture in pixels.
const WIDTH: usize = 1400;
/// Height of every picture in pixels.
const HEIGHT: usize = 900;
/// Left edge of the legend.
const LEGEND_X: f32 = 1190.0;

/// What the colours of a picture mean.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Tint {
    /// Which tissue.
    Material,
    /// Length of the displacement, up to this many metres.
    Displacement(f32),
    /// Largest principal strain, up to this.
    Strain(f32),
}

/// What is pictured.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// The tissue.
    pub model: &'a Model,
    /// The tool.
    pub tool: &'a Tool,
    /// Direction of the press, world frame.
    pub direction: Vec3,
    /// The tissue before the press.
    pub before: &'a Snapshot,
    /// The tissue at the end of the hold.
    pub pressed: &'a Snapshot,
}

/// Writes all pictures into `directory`, with one tick of `bar` for each.
pub fn write_all(subject: &Subject, directory: &Path, bar: &ProgressBar) -> anyhow::Result<()> {
    let Subject { before, pressed, .. } = subject;
    let displacement = Tint::Displacement(top(pressed.displacements_m.iter().copied()));
    let slice = slice::Slice::new(subject);
    let strain = Tint::Strain(top(slice.strains()));

    type Draw<'a> = Box<dyn Fn() -> anyhow::Result<Canvas> + 'a>;
    let pictures: [(&str, Draw); 7] = [
        ("outside_before.png", Box::new(|| outside::whole(subject, before, Tint::Material))),
        ("outside_pressed.png", Box::new(|| outside::whole(subject, pressed, Tint::Material))),
        ("outside_displacement.png", Box::new(|| outside::whole(subject, pressed, displacement))),
        ("cutaway_pressed.png", Box::new(|| outside::cut_open(subject, &slice))),
        ("section_material.png", Box::new(|| slice.draw(subject, Tint::Material))),
        ("section_displacement.png", Box::new(|| slice.draw(subject, displacement))),
        ("section_strain.png", Box::new(|| slice.draw(subject, strain))),
    ];
    bar.set_length(pictures.len() as u64);
    for (name, draw) in pictures {
        bar.set_message(name);
        draw()?.save(&directory.join(name))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}

/// The largest value; something above 0 where nothing moved.
fn top(values: impl Iterator<Item = f32>) -> f32 {
    values.filter(|v| v.is_finite()).fold(1e-6, f32::max)
}

/// The directions of a body that lies so that it is pressed from above.
#[derive(Clone, Copy, Debug)]
struct Lying {
    /// The world axis that is most opposed to the press.
    up: Vec3,
    /// The world axis towards the head, or another one when the press goes along the body.
    head: Vec3,
    /// The side that a viewer with the head on the left looks from.
    side: Vec3,
}

impl Lying {
    fn new(direction: Vec3) -> Self {
        let axis = direction.iamax();
        let up = Vec3::ith(axis, -direction[axis].signum());
        let head = if axis == 2 { Vec3::y() } else { Vec3::z() };
        Self { up, head, side: up.cross(&head) }
    }
}

/// The side of the body that a world axis points to: the world of a patient has x to the right, y to the front, z to the head.
fn side_name(axis: Vec3) -> &'static str {
    let index = axis.iamax();
    let names = [["left", "right"], ["back", "front"], ["feet", "head"]];
    names[index][usize::from(axis[index] > 0.0)]
}

/// A length for a scale: 1, 2 or 5 times a power of ten, at most `limit_m`.
fn round_length(limit_m: f64) -> f64 {
    let power = 10_f64.powf(limit_m.log10().floor());
    power * [5.0, 2.0, 1.0].into_iter().find(|step| step * power <= limit_m).unwrap_or(1.0)
}

fn millimetres(length_m: f64) -> String {
    format!("{} mm", (length_m * 1e4).round() / 10.0)
}

/// The headline of a picture and the line below it.
fn headline(canvas: &mut Canvas, subject: &Subject, snapshot: &Snapshot, what: &str) {
    canvas.text(what, [34.0, 48.0], 25.0, Anchor::Start, INK);
    let force = snapshot.wrench.force_n.norm();
    let state = if snapshot.indentation_m > 0.0 {
        format!("{} deep, force {force:.2} N, {}", millimetres(snapshot.indentation_m), subject.tool.name)
    } else {
        format!("before the press, {}", subject.tool.name)
    };
    canvas.text(&state, [34.0, 76.0], 16.0, Anchor::Start, INK);
}

/// What the colours mean, at the right of the picture. `seen` says which materials are in it.
fn legend(canvas: &mut Canvas, model: &Model, tint: Tint, seen: [bool; 16]) {
    let at = [LEGEND_X, 130.0];
    match tint {
        Tint::Material => {
            let named = model.materials().iter().enumerate().filter(|(index, _)| seen[index + 1]);
            let entries: Vec<(String, Colour)> =
                named.map(|(index, m)| (m.name.clone(), material_colour(model, index as u8 + 1))).collect();
            canvas.legend(at, &entries);
        }
        Tint::Displacement(top_m) => canvas.colour_bar(at, "Displacement", "mm", f64::from(top_m) * 1e3),
        Tint::Strain(top) => canvas.colour_bar(at, "Principal strain", "%", f64::from(top) * 1e2),
    }
}

/// The colour of a material by its index, 1 to 15.
fn material_colour(model: &Model, material: u8) -> Colour {
    let index = usize::from(material);
    let name = model.materials().get(index.wrapping_sub(1)).map_or("", |m| m.name.as_str());
    colour::of_material(name, index)
}
