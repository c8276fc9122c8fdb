//! How much tissue a tool's contact moves at once.

use crate::math::Vec3;
use crate::model::surface::Row;
use crate::solver::tool::Contact;

/// Adds up what contact points push the nodes with that carry them. Keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Carried {
    pushes: Vec<(u32, Vec3)>,
}

impl Carried {
    /// The mass that the contacts' pushes meet along their sum, in kg; infinite where nothing that carries them can move. `rows` are the contact surface's;
    /// `mobility` says what the square of a push on a node is worth in velocity: pᵀ M⁻¹ p, for the axes that are free.
    ///
    /// Pushes P that add up to s change a tool's velocity along s as the mass s² / Σ pᵀ M⁻¹ p would, p being what a node gets of them: no more than what it takes to
    /// move all points alike (Thomson's principle), and as much where the pushes are those that do.
    pub fn mass_kg(
        &mut self,
        contacts: &[Contact],
        rows: &[Row],
        mobility: impl Fn(u32, &Vec3) -> f64,
    ) -> f64 {
        self.pushes.clear();
        let mut all = Vec3::zeros();
        for contact in contacts {
            let push = contact.normal * contact.force_n.dot(&contact.normal).max(0.0);
            all += push;
            for (vertex, share) in contact.vertices.into_iter().zip(contact.shares) {
                let Row { nodes, weights } = rows[vertex as usize];
                let carriers =
                    nodes.into_iter().zip(weights).filter(|(_, weight)| share * f64::from(*weight) != 0.0);
                self.pushes.extend(carriers.map(|(node, weight)| (node, push * (share * f64::from(weight)))));
            }
        }
        self.pushes.sort_unstable_by_key(|(node, _)| *node);
        let nodes = self.pushes.chunk_by(|a, b| a.0 == b.0);
        all.norm_squared() / nodes.map(|of| mobility(of[0].0, &of.iter().map(|p| p.1).sum())).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::surface::ROW;

    const KG: f64 = 2e-3;

    /// Vertices that lie on a node each, but for the last, which lies between the first four.
    fn rows() -> Vec<Row> {
        let at = |node: u32| Row { nodes: [node; ROW], weights: std::array::from_fn(|i| f32::from(i == 0)) };
        let weights = std::array::from_fn(|i| if i < 4 { 0.25 } else { 0.0 });
        let between = Row { nodes: std::array::from_fn(|i| if i < 4 { i as u32 } else { 0 }), weights };
        (0..6).map(at).chain([between]).collect()
    }

    fn pressing(vertex: u32, force_n: f64) -> Contact {
        Contact {
            point_m: Vec3::zeros(),
            normal: -Vec3::z(),
            depth_m: 0.0,
            force_n: Vec3::new(0.3, 0.0, -force_n),
            material: 1,
            vertices: [vertex; 3],
            shares: [1.0, 0.0, 0.0],
        }
    }

    fn free(_: u32, push: &Vec3) -> f64 {
        push.norm_squared() / KG
    }

    #[test]
    fn points_move_the_nodes_that_carry_them_and_those_together_once() {
        let mass = |contacts: &[Contact]| Carried::default().mass_kg(contacts, &rows(), free) / KG;
        assert!((mass(&[pressing(2, 0.7)]) - 1.0).abs() < 1e-12, "its own node");
        assert!((mass(&[pressing(6, 0.7)]) - 4.0).abs() < 1e-6, "four nodes alike");
        assert!((mass(&[pressing(4, 0.7), pressing(5, 0.7)]) - 2.0).abs() < 1e-12, "two nodes");
        assert!((mass(&[pressing(4, 0.7), pressing(4, 0.1)]) - 1.0).abs() < 1e-12, "the same node twice");
        let sides = [Contact { normal: Vec3::x(), force_n: Vec3::x(), ..pressing(4, 0.0) }, pressing(5, 1.0)];
        assert!((mass(&sides) - 1.0).abs() < 1e-12, "askew: s² = 2, and 1 for each node");
    }

    #[test]
    fn what_is_held_moves_nobody() {
        let free_from =
            |first: u32| move |node: u32, push: &Vec3| if node < first { 0.0 } else { free(node, push) };
        let mass = |first: u32, vertex: u32| {
            Carried::default().mass_kg(&[pressing(vertex, 1.0)], &rows(), free_from(first)) / KG
        };
        assert_eq!(mass(4, 6), f64::INFINITY);
        // ¼² for one node of four.
        assert!((mass(3, 6) - 16.0).abs() < 1e-6);
        assert!((mass(4, 5) - 1.0).abs() < 1e-12);
    }
}
