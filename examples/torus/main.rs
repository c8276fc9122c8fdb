//! A torus of soft tissue hangs by its top under its weight: `cargo run --release --example torus`.
//!
//! The body of Magnoux and Ozell (2021), built from a closed mesh and computed by the meshless model in sixty steps a second, as theirs. One table goes to
//! the terminal; the torus before and after, as a picture, to `--out DIR`.

mod body;
// Pressing and cutting need what hanging does not.
#[allow(dead_code)]
#[path = "../common/picture/mod.rs"]
mod drawing;
mod picture;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, bail};
use clap::Parser;
use comfy_table::Table;
use palpate::math::Vec3;
use palpate::sim::{Sim, SimDesc};
use palpate::solver::method::{EfgDesc, Method};

use picture::Moment;
pub use picture::SIZE;

/// Triangles of the surface.
const TRIANGLES: u32 = 11_520;
/// Steps in a second, as many as a screen shows.
const RATE_HZ: f64 = 60.0;

/// Hangs a torus of soft tissue up by its top and lets go of the rest.
#[derive(Clone, Debug, Parser)]
#[command(name = "torus")]
pub struct Options {
    /// Edge length of a cell
    #[arg(long, value_name = "MM", default_value_t = 4.0)]
    pub cell_mm: f64,

    /// Young's modulus
    #[arg(long, value_name = "KPA", default_value_t = 8.0)]
    pub young_kpa: f64,

    /// How long it hangs before the picture is taken
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    pub seconds: f64,

    /// Folder for the picture
    #[arg(long, value_name = "DIR", default_value = "out/torus")]
    pub out: PathBuf,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(hung) => {
            println!("{}", hung.table);
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("torus: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// What became of the torus.
#[derive(Debug)]
pub struct Hung {
    /// How far its lowest point sank, in m.
    pub sag_m: f64,
    /// Largest speed of a node at the end, in m/s.
    pub speed_m_s: f64,
    /// All that is told of it.
    pub table: Table,
}

/// Does the whole job.
pub fn run(options: &Options) -> anyhow::Result<Hung> {
    if !(0.0..=600.0).contains(&options.seconds) {
        bail!("--seconds {}: 0 to 600 are possible", options.seconds);
    }
    std::fs::create_dir_all(&options.out)
        .with_context(|| format!("cannot make the folder {}", options.out.display()))?;
    let model = Arc::new(body::build(options.cell_mm * 1e-3, TRIANGLES, options.young_kpa * 1e3)?);
    let desc = SimDesc {
        method: Method::Efg(EfgDesc::default()),
        gravity_m_s2: Vec3::new(0.0, 0.0, -9.81),
        rest_under_gravity: false,
        step_s: 1.0 / RATE_HZ,
        ..SimDesc::default()
    };
    let mut sim = Sim::new(model.clone(), &desc)?;
    let mut surface = sim.open_surface(0)?;
    let before = Moment::of(&surface.map()?);

    let (mut iterations, mut residual, mut wall_s) = (0, 0.0_f64, 0.0);
    let steps = (options.seconds * RATE_HZ) as u32;
    for _ in 0..steps {
        sim.step()?;
        let statistics = sim.statistics();
        iterations += statistics.cg_iterations;
        residual = residual.max(statistics.true_residual);
        wall_s += statistics.step_wall_s;
    }
    let after = Moment::of(&surface.map()?);
    picture::write(&before, &after, options.young_kpa, &options.out.join("torus.png"))?;

    let sag_m = before.lowest() - after.lowest();
    let velocities = sim.nodes(palpate::sim::NodeField::Velocity);
    let speed_m_s = velocities.iter().map(Vec3::norm).fold(0.0, f64::max);
    let statistics = sim.statistics();
    let mut table = Table::new();
    let per_step = |sum: f64| sum / f64::from(steps.max(1));
    for (name, value) in [
        ("cells, nodes", format!("{}, {}", model.lattice().cell_count(), model.lattice().node_count())),
        ("triangles", model.surfaces()[0].triangles.len().to_string()),
        ("runs on", sim.place().to_string()),
        ("iterations per step", format!("{:.1}", per_step(iterations.into()))),
        ("true residual at most", format!("{residual:.1e}")),
        ("time per step", format!("{:.2} ms of {:.2} ms", per_step(wall_s) * 1e3, 1e3 / RATE_HZ)),
        ("lowest point sank by", format!("{:.2} mm", sag_m * 1e3)),
        ("fastest node at the end", format!("{:.2} mm/s", speed_m_s * 1e3)),
        ("strain at most", format!("{:.1} %", statistics.max_strain * 1e2)),
        ("picture", options.out.join("torus.png").display().to_string()),
    ] {
        table.add_row([name.to_owned(), value]);
    }
    Ok(Hung { sag_m, speed_m_s, table })
}
