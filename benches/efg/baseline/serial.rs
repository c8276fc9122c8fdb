//! On the processor: one thread walks the arrays, as the paper's own serial program does.

use palpate::error::Result;
use palpate::math::Vec3;

use super::{Baseline, Body, ROW, Setting};

type Field = Vec<[f32; 3]>;

/// A body and the vectors of its system.
pub struct Serial {
    body: Body,
    setting: Setting,
    u: Field,
    v: Field,
    x: Field,
    r: Field,
    p: Field,
    q: Field,
    felt: [f32; 3],
}

fn dot(a: &Field, b: &Field) -> f64 {
    let products = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| f64::from(*a) * f64::from(*b));
    products.sum()
}

impl Body {
    /// Algorithm 2: adds `factor` times what stress of the motion p makes elements give to their nodes.
    fn distribute(&self, factor: f32, p: &Field, q: &mut Field) {
        for (element, &length) in self.lengths.iter().enumerate() {
            let row = element * ROW..element * ROW + usize::from(length);
            let (nodes, gradients) = (&self.nodes[row.clone()], &self.gradients[row]);
            let mut g = [[0.0; 3]; 3];
            for (&node, along) in nodes.iter().zip(gradients) {
                let moved = p[node as usize];
                for i in 0..3 {
                    for j in 0..3 {
                        g[i][j] += moved[i] * along[j];
                    }
                }
            }
            let by = self.stiffness[element];
            let (pressure, half) = (by.lambda * (g[0][0] + g[1][1] + g[2][2]), 0.5 * by.two_mu);
            let mut stress = [[0.0; 3]; 3];
            for i in 0..3 {
                for j in 0..3 {
                    stress[i][j] =
                        factor * (half * (g[i][j] + g[j][i]) + if i == j { pressure } else { 0.0 });
                }
            }
            for (&node, along) in nodes.iter().zip(gradients) {
                let given = &mut q[node as usize];
                for i in 0..3 {
                    given[i] += stress[i][0] * along[0] + stress[i][1] * along[1] + stress[i][2] * along[2];
                }
            }
        }
    }
}

impl Serial {
    /// At rest.
    pub fn new(body: Body, setting: Setting) -> Self {
        let zeros = || vec![[0.0; 3]; body.mass_kg.len()];
        let [u, v, x] = [zeros(), zeros(), zeros()];
        let [r, p, q] = [zeros(), zeros(), zeros()];
        Self { body, setting, u, v, x, r, p, q, felt: [0.0; 3] }
    }

    /// Weight and the sphere's springs, times dt.
    fn push(&mut self, centre_m: Vec3) {
        let Setting { dt, gravity_m_s2, radius_m, push_n_m, .. } = self.setting;
        let centre = centre_m.map(|x| x as f32);
        self.felt = [0.0; 3];
        for (node, r) in self.r.iter_mut().enumerate() {
            let (rest, u) = (self.body.rest_m[node], self.u[node]);
            let d: [f32; 3] = std::array::from_fn(|i| rest[i] + u[i] - centre[i]);
            let distance = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            let deep = radius_m - distance;
            let push = if deep > 0.0 { push_n_m * deep / distance } else { 0.0 };
            *r = d.map(|d| dt * push * d);
            r[2] -= dt * gravity_m_s2 * self.body.mass_kg[node];
            for i in 0..3 {
                self.felt[i] -= push * d[i];
            }
        }
    }

    /// q = (M + dt² K) p.
    fn multiply(&mut self) {
        for ((q, p), mass) in self.q.iter_mut().zip(&self.p).zip(&self.body.mass_kg) {
            *q = p.map(|p| mass * p);
        }
        self.body.distribute(self.setting.dt.powi(2), &self.p, &mut self.q);
    }
}

impl Baseline for Serial {
    fn step(&mut self, centre_m: Vec3) -> Result<u32> {
        let dt = self.setting.dt;
        self.push(centre_m);
        self.body.distribute(-dt, &self.u, &mut self.r);
        for (r, _) in self.r.iter_mut().zip(&self.body.is_held).filter(|(_, is_held)| **is_held) {
            *r = [0.0; 3];
        }
        self.x.fill([0.0; 3]);
        self.p.clone_from(&self.r);
        let mut rr = dot(&self.r, &self.r);
        let enough = rr * self.setting.tolerance.powi(2);
        let mut iterations = 0;
        while rr > enough {
            self.multiply();
            let alpha = (rr / dot(&self.p, &self.q)) as f32;
            let Self { body, x, r, p, q, .. } = self;
            for node in 0..x.len() {
                for i in 0..3 {
                    x[node][i] += alpha * p[node][i];
                    r[node][i] = if body.is_held[node] { 0.0 } else { r[node][i] - alpha * q[node][i] };
                }
            }
            let left = dot(r, r);
            let beta = (left / rr) as f32;
            rr = left;
            for (p, r) in p.iter_mut().zip(r) {
                *p = std::array::from_fn(|i| r[i] + beta * p[i]);
            }
            iterations += 1;
        }
        for ((x, v), u) in self.x.iter().zip(&mut self.v).zip(&mut self.u) {
            for i in 0..3 {
                v[i] += x[i];
                u[i] += dt * v[i];
            }
        }
        Ok(iterations)
    }

    fn displacements(&self) -> Result<Vec<[f32; 3]>> {
        Ok(self.u.clone())
    }

    fn felt_n(&self) -> [f32; 3] {
        self.felt
    }
}
