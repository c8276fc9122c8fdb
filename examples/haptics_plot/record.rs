//! The record of a servo: a line for each tick.

use std::path::Path;

use anyhow::{Context, ensure};

/// What the picture shows of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Tick {
    pub time_s: f64,
    /// How far the device is along the way that it goes, in m.
    pub depth_m: f64,
    /// The same of the tool that hangs on it.
    pub tool_m: f64,
    /// What the motors do, in N.
    pub force_n: f64,
    /// Negative before the first step.
    pub age_s: f64,
    pub latency_s: f64,
    /// PLP_SERVO_ bits.
    pub flags: u32,
}

/// Reads a record; the depth is measured from its first position towards the farthest one.
pub fn read(path: &Path) -> anyhow::Result<Vec<Tick>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().context("the record is empty")?.split(',').collect();
    let column =
        |name: &str| names.iter().position(|n| *n == name).with_context(|| format!("no column {name}"));
    let wanted = [
        "time_s",
        "x_m",
        "y_m",
        "z_m",
        "tool_x_m",
        "tool_y_m",
        "tool_z_m",
        "device_x_n",
        "device_y_n",
        "device_z_n",
        "age_s",
        "latency_s",
        "servo_flags",
    ];
    let columns = wanted.iter().map(|name| column(name)).collect::<anyhow::Result<Vec<_>>>()?;
    let rows = lines
        .enumerate()
        .map(|(at, line)| {
            let fields: Vec<&str> = line.split(',').collect();
            let numbers = columns.iter().map(|&c| fields.get(c).and_then(|field| field.parse::<f64>().ok()));
            numbers.collect::<Option<Vec<f64>>>().with_context(|| format!("line {} is no tick", at + 2))
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    ensure!(rows.len() > 1, "a record of {} ticks cannot be drawn", rows.len());

    let first = three(&rows[0][1..4]);
    let way = |at: [f64; 3]| [at[0] - first[0], at[1] - first[1], at[2] - first[2]];
    let farthest =
        rows.iter().map(|row| way(three(&row[1..4]))).max_by(|a, b| length(*a).total_cmp(&length(*b)));
    let direction = farthest.unwrap_or_default().map(|x| x / length(farthest.unwrap_or_default()).max(1e-9));
    let along = |at: &[f64]| way(three(at)).iter().zip(direction).map(|(a, b)| a * b).sum();
    let ticks = rows.iter().map(|row| Tick {
        time_s: row[0],
        depth_m: along(&row[1..4]),
        tool_m: along(&row[4..7]),
        force_n: length(three(&row[7..10])),
        age_s: row[10],
        latency_s: row[11],
        flags: row[12] as u32,
    });
    Ok(ticks.collect())
}

fn three(numbers: &[f64]) -> [f64; 3] {
    [numbers[0], numbers[1], numbers[2]]
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}
