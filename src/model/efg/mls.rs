//! Moving least squares with a linear basis: shape functions and their gradients at a point, from nodes that lie anyhow about it.
//!
//! With weights wᵢ, the weighted mean X̄ of the nodes, rᵢ = Xᵢ − X̄ and the moment matrix M = Σ wᵢ rᵢ rᵢᵀ, the (diffuse) gradients are ∇φᵢ = wᵢ M⁻¹ rᵢ and
//! φᵢ = wᵢ / Σ w + (x − X̄)·∇φᵢ. They reproduce every linear field: Σ φᵢ = 1, Σ φᵢ Xᵢ = x, Σ ∇φᵢ = 0, Σ Xᵢ ∇φᵢᵀ = I.

use crate::math::{Mat3, Vec3};

/// Smallest over largest eigenvalue of M that nodes must span: with less they lie nearly in a plane, and more are needed.
const LEAST_SPAN: f64 = 0.05;
/// Radius of the weight function's support, in distances of the farthest node.
const SUPPORT: f64 = 1.6;

/// Shape functions at a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// φ of each node.
    pub phi: Vec<f64>,
    /// ∇φ of each node, 1/m.
    pub gradient: Vec<Vec3>,
    /// w / Σ w of each node: their weighted mean is X̄.
    pub share: Vec<f64>,
    /// X̄ in m.
    pub mean: Vec3,
}

/// The quartic spline 1 − 6 r² + 8 r³ − 3 r⁴, nothing beyond 1.
fn weight(r: f64) -> f64 {
    let r = r.min(1.0);
    1.0 + r * r * (-6.0 + r * (8.0 - 3.0 * r))
}

/// Whether nodes span space about their weighted mean well enough.
fn spans(moment: &Mat3) -> bool {
    let eigenvalues = moment.symmetric_eigenvalues();
    eigenvalues.min() >= LEAST_SPAN * eigenvalues.max() && eigenvalues.max() > 0.0
}

/// Shape functions at `x` of nodes at `nodes`; `None` where these lie nearly in a plane.
pub fn shape(x: Vec3, nodes: &[Vec3]) -> Option<Shape> {
    let farthest = nodes.iter().map(|node| (node - x).norm()).fold(0.0, f64::max);
    let weights: Vec<f64> =
        nodes.iter().map(|node| weight((node - x).norm() / (SUPPORT * farthest))).collect();
    let total: f64 = weights.iter().sum();
    let mean = nodes.iter().zip(&weights).map(|(node, w)| node * (w / total)).sum::<Vec3>();
    let moment = nodes
        .iter()
        .zip(&weights)
        .map(|(node, w)| (node - mean) * (node - mean).transpose() * *w)
        .sum::<Mat3>();
    let inverse = if spans(&moment) { moment.try_inverse()? } else { return None };
    let gradient: Vec<Vec3> =
        nodes.iter().zip(&weights).map(|(node, w)| inverse * (node - mean) * *w).collect();
    let phi = gradient.iter().zip(&weights).map(|(g, w)| w / total + (x - mean).dot(g)).collect();
    let share = weights.iter().map(|w| w / total).collect();
    Some(Shape { phi, gradient, share, mean })
}

/// How many of `nodes`, sorted from the nearest, a point needs: at least `least`, and more while they lie nearly in a plane. The shape functions of those;
/// `None` where all together do not span space.
pub fn shape_of_nearest(x: Vec3, nodes: &[Vec3], least: usize) -> Option<Shape> {
    (least.min(nodes.len())..=nodes.len()).find_map(|count| shape(x, &nodes[..count]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Noise;

    fn scattered(noise: &mut Noise, count: usize) -> Vec<Vec3> {
        (0..count).map(|_| Vec3::from_fn(|_, _| 1e-3 * noise.next())).collect()
    }

    #[test]
    fn every_linear_field_is_reproduced_with_its_gradient() {
        let mut noise = Noise(4);
        let mut found = 0;
        for count in (8..20).cycle().take(120) {
            let nodes = scattered(&mut noise, count);
            let x = Vec3::from_fn(|_, _| 3e-4 * noise.next());
            // Scattered anyhow, some lie nearly in a plane.
            let Some(shape) = shape(x, &nodes) else { continue };
            found += 1;
            let (value, slope) = (0.7, Vec3::new(3.0, -2.0, 5.0));
            let field: Vec<f64> = nodes.iter().map(|node| value + slope.dot(node)).collect();
            let there: f64 = shape.phi.iter().zip(&field).map(|(phi, f)| phi * f).sum();
            let gradient: Vec3 = shape.gradient.iter().zip(&field).map(|(g, f)| g * *f).sum();
            assert!((there - value - slope.dot(&x)).abs() < 1e-13, "{there}");
            assert!((gradient - slope).norm() < 1e-11, "{gradient}");
            assert!((shape.phi.iter().sum::<f64>() - 1.0).abs() < 1e-13);
            assert!(shape.gradient.iter().sum::<Vec3>().norm() < 1e-9);
        }
        assert!(found > 60, "{found} of 120");
    }

    #[test]
    fn eight_corners_have_an_eighth_each_and_their_signs_over_four_cells() {
        let h = 2e-3;
        let signs = |i: usize| Vec3::from_fn(|axis, _| if i >> axis & 1 == 1 { 1.0 } else { -1.0 });
        let nodes: Vec<Vec3> = (0..8).map(|i| signs(i) * (h / 2.0)).collect();
        let shape = shape(Vec3::zeros(), &nodes).unwrap();
        for i in 0..8 {
            assert!((shape.phi[i] - 0.125).abs() < 1e-14);
            assert!((shape.gradient[i] - signs(i) / (4.0 * h)).norm() < 1e-10);
        }
    }

    #[test]
    fn nodes_in_a_plane_are_not_enough_and_the_next_one_out_of_it_is_taken() {
        let mut noise = Noise(2);
        let mut nodes = scattered(&mut noise, 9);
        nodes.iter_mut().for_each(|node| node.z = 0.0);
        assert_eq!(shape(Vec3::zeros(), &nodes), None);
        nodes.extend([Vec3::new(0.0, 0.0, 1.2e-3), Vec3::new(0.0, 0.0, -1.3e-3)]);
        let shape = shape_of_nearest(Vec3::zeros(), &nodes, 8).unwrap();
        assert!(shape.phi.len() > 9, "{}", shape.phi.len());
    }
}
