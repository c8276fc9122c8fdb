//! How much tissue a tool's contact moves at once.

use crate::math::Vec3;
use crate::model::surface::Row;
use crate::solver::tool::Contact;

/// Of a point's mobility, how much must belong to free axes of nodes for the point to count as movable: what contact itself takes.
const MOVABLE: f64 = 1e-3;

/// What the square of a push on a node is worth in velocity, pᵀ M⁻¹ p, in 1/kg and so on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mobility {
    /// Along the axes that are free.
    pub free: f64,
    /// Along all of them.
    pub all: f64,
}

/// Adds up what contact points push the nodes with that carry them. Keeps its memory.
#[derive(Debug, Default)]
pub(super) struct Carried {
    pushes: Vec<(u32, Vec3)>,
}

impl Carried {
    /// The mass that the contacts' pushes meet along their sum, in kg; not finite where nothing pushes anything that can move. `rows` are the contact surface's.
    ///
    /// Pushes P that add up to s change a tool's velocity along s as the mass s² / Σ pᵀ M⁻¹ p would, p being what a node gets of them: no more than what it takes to
    /// move all points alike (Thomson's principle), and as much where the pushes are those that do.
    pub fn mass_kg<'a>(
        &mut self,
        contacts: impl Iterator<Item = &'a Contact>,
        rows: &[Row],
        mobility: impl Fn(u32, &Vec3) -> Mobility,
    ) -> f64 {
        self.pushes.clear();
        let mut all = Vec3::zeros();
        for contact in contacts {
            let push = contact.normal * contact.force_n.dot(&contact.normal).max(0.0);
            all += push;
            self.pushes.extend(carriers(contact, rows).map(|(node, weight)| (node, push * weight)));
        }
        self.pushes.sort_unstable_by_key(|(node, _)| *node);
        let nodes = self.pushes.chunk_by(|a, b| a.0 == b.0);
        let square = |of: &[(u32, Vec3)]| mobility(of[0].0, &of.iter().map(|(_, push)| push).sum()).free;
        all.norm_squared() / nodes.map(square).sum::<f64>()
    }
}

/// Whether nothing that carries a contact point can move: a wall.
pub(super) fn is_held(contact: &Contact, rows: &[Row], mobility: impl Fn(u32, &Vec3) -> Mobility) -> bool {
    let sum = carriers(contact, rows).map(|(node, weight)| mobility(node, &(contact.normal * weight)));
    let (free, all) = sum.fold((0.0, 0.0), |sum, of| (sum.0 + of.free, sum.1 + of.all));
    free <= MOVABLE * all
}

/// The nodes that carry a contact point, with their shares; one that several of its vertices hang on comes as often.
fn carriers(contact: &Contact, rows: &[Row]) -> impl Iterator<Item = (u32, f64)> {
    contact.vertices.into_iter().zip(contact.shares).flat_map(|(vertex, share)| {
        let Row { nodes, weights } = rows[vertex as usize];
        let shares = weights.map(|weight| share * f64::from(weight));
        nodes.into_iter().zip(shares).filter(|(_, share)| *share != 0.0)
    })
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

    /// Nodes below the first are held.
    fn free_from(first: u32) -> impl Fn(u32, &Vec3) -> Mobility + Copy {
        move |node, push| {
            let all = push.norm_squared() / KG;
            Mobility { free: if node < first { 0.0 } else { all }, all }
        }
    }

    #[test]
    fn points_move_the_nodes_that_carry_them_and_those_together_once() {
        let mass =
            |contacts: &[Contact]| Carried::default().mass_kg(contacts.iter(), &rows(), free_from(0)) / KG;
        assert!((mass(&[pressing(2, 0.7)]) - 1.0).abs() < 1e-12, "its own node");
        assert!((mass(&[pressing(6, 0.7)]) - 4.0).abs() < 1e-6, "four nodes alike");
        assert!((mass(&[pressing(4, 0.7), pressing(5, 0.7)]) - 2.0).abs() < 1e-12, "two nodes");
        assert!((mass(&[pressing(4, 0.7), pressing(4, 0.1)]) - 1.0).abs() < 1e-12, "the same node twice");
        let sides = [Contact { normal: Vec3::x(), force_n: Vec3::x(), ..pressing(4, 0.0) }, pressing(5, 1.0)];
        assert!((mass(&sides) - 1.0).abs() < 1e-12, "askew: s² = 2, and 1 for each node");
    }

    #[test]
    fn what_is_held_moves_nobody() {
        let mass = |first: u32, vertex: u32| {
            Carried::default().mass_kg([pressing(vertex, 1.0)].iter(), &rows(), free_from(first)) / KG
        };
        assert!(!mass(4, 6).is_finite());
        // ¼² for one node of four.
        assert!((mass(3, 6) - 16.0).abs() < 1e-6);
        assert!((mass(4, 5) - 1.0).abs() < 1e-12);
        for (first, vertex, expected) in [(4, 6, true), (3, 6, false), (4, 5, false), (6, 5, true)] {
            assert_eq!(is_held(&pressing(vertex, 1.0), &rows(), free_from(first)), expected, "{vertex}");
        }
    }
}
