//! Texture coordinates of walls.
//!
//! Each point of a wall has its own, from a neighbour's that was there before: as far from it as it is, in the plane of their triangle. So they keep lengths along
//! what is bent in one direction, as a blade's way is, and never change once they are there. Where fronts of a cut meet that went around something, what lies between is stretched.

use std::collections::VecDeque;

use super::hash::Map;
use super::walls::Walls;
use crate::math::Vec3;

/// Texture coordinates at a point, and the plane in which they run on from there.
#[derive(Clone, Copy, Debug)]
pub struct Chart {
    /// Texture coordinates, in cells.
    uv: [f64; 2],
    normal: Vec3,
    /// The direction in the plane along which the first coordinate grows.
    along: Vec3,
}

impl Chart {
    /// Texture coordinates, in cells.
    pub fn uv(&self) -> [f32; 2] {
        self.uv.map(|x| x as f32)
    }

    /// In the plane with a normal, the first coordinate along the axis of the grid that is closest to it.
    fn first(normal: Vec3, at: Vec3) -> Self {
        let along = Vec3::ith(normal.iamin(), 1.0);
        let along = (along - normal * normal.dot(&along)).normalize();
        Self { uv: [along.dot(&at), normal.cross(&along).dot(&at)], normal, along }
    }

    /// In another plane, turned the shortest way.
    fn turned(&self, normal: Vec3) -> Self {
        let normal = if normal.dot(&self.normal) < 0.0 { -normal } else { normal };
        let turn = self.normal.cross(&normal);
        let cosine = self.normal.dot(&normal);
        let along = self.along;
        let along = along * cosine + turn.cross(&along) + turn * (turn.dot(&along) / (1.0 + cosine));
        Self { along: (along - normal * normal.dot(&along)).normalize(), normal, ..*self }
    }

    /// So far from here.
    fn moved(&self, by: Vec3) -> Self {
        let across = self.normal.cross(&self.along);
        Self { uv: [self.uv[0] + self.along.dot(&by), self.uv[1] + across.dot(&by)], ..*self }
    }
}

/// Gives the points of new triangles that have none texture coordinates.
pub fn unroll(walls: &mut Walls, new: &[u32], cell_m: f64) {
    let mut of_point: Map<u32, Vec<u32>> = Map::default();
    for &w in new {
        for point in walls.triangles[w].corners {
            of_point.entry(point).or_default().push(w);
        }
    }
    let mut queue: VecDeque<u32> = VecDeque::new();
    let is_known = |walls: &Walls, w: u32| {
        walls.triangles[w].corners.iter().any(|&point| walls.points[point].chart.is_some())
    };
    queue.extend(new.iter().filter(|&&w| is_known(walls, w)));
    for &first in new {
        loop {
            while let Some(w) = queue.pop_front() {
                for point in spread(walls, w, cell_m) {
                    queue.extend(&of_point[&point]);
                }
            }
            if is_known(walls, first) {
                break;
            }
            queue.push_back(first);
        }
    }
}

/// Gives a triangle's points that have none texture coordinates; returns those points.
fn spread(walls: &mut Walls, w: u32, cell_m: f64) -> Vec<u32> {
    let corners = walls.triangles[w].corners;
    let new: Vec<u32> = corners.into_iter().filter(|&point| walls.points[point].chart.is_none()).collect();
    if new.is_empty() {
        return new;
    }
    let at = |point: u32| walls.points[point].at / cell_m;
    let [a, b, c] = corners.map(at);
    let normal = (b - a).cross(&(c - a)).try_normalize(1e-9);
    let known = corners.into_iter().find_map(|point| Some((at(point), walls.points[point].chart?)));
    let (from, chart) = known.unwrap_or_else(|| (a, Chart::first(normal.unwrap_or(Vec3::z()), a)));
    let chart = normal.map_or(chart, |normal| chart.turned(normal));
    let charts: Vec<Chart> = new.iter().map(|&point| chart.moved(at(point) - from)).collect();
    for (&point, chart) in new.iter().zip(charts) {
        walls.points[point].chart = Some(chart);
    }
    new
}
