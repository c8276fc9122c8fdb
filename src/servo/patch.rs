//! Where and how widely a tool touches tissue, and how stiff and heavy a half-space would be there.

use std::f64::consts::PI;

use super::contact_model::push_direction;
use crate::math::{Mat3, Mat6, Pose, Vec3};
use crate::solver::tool::Contact;

/// What tissue is made of where it is touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tissue {
    /// Young's modulus in Pa.
    pub young_pa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Its viscosity as a share of its stiffness, in s: the β of Rayleigh's damping.
    pub relaxation_s: f64,
    /// In kg/m³.
    pub density_kg_m3: f64,
}

/// What is known of a tool's contact. World axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// The middle of the contact.
    pub point_m: Vec3,
    /// Unit direction in which the tissue pushes; zero where it pushes from several sides, and there is no one normal.
    pub normal: Vec3,
    /// Radius of a circle as large as the contact, in m.
    pub radius_m: f64,
    /// What is touched, on average.
    pub tissue: Tissue,
    /// Whether friction holds the tissue to the tool: without, there is no tangential stiffness.
    pub sticks: bool,
    /// Edge of the cells that the tissue is divided into, in m; 0 where it is not.
    pub cell_m: f64,
    /// What those of its points resist by along the normal that cannot move, in N/m; 0 without such points.
    pub wall_n_per_m: f64,
    /// Share of the force that is on them.
    pub wall_share: f64,
}

/// What resists a tool that goes another way than in the last step, in N/m and so on about its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// That of the nodes under the contact: they go on with what velocity they were given.
    pub cell: Mat6,
    /// That of the tissue behind: waves carry away what it was given, as a damper takes it.
    pub waves: Mat6,
    /// That of the same nodes along any way. A surface has facets and bends, and a tool that slides from one to the next meets by its next normal what lay across
    /// its last: what is led must not be free along a way that may be a blow a step later.
    pub around: Mat6,
}

/// Share of the largest friction from which on a contact counts as sliding.
const SLIDING: f64 = 0.9;
/// Least 1 − 2 ν, that of the largest Poisson's ratio that models take: a pressure wave of incompressible tissue would have no end.
const LEAST_GIVE: f64 = 0.02;

impl Patch {
    /// The contact that these points make, or `None` where nothing pushes. `tissue` says what a material's index stands for, `is_held` whether a point is on
    /// what cannot move; `friction` is the tool's coefficient; `cell_m` the edge of the tissue's cells, 0 where it is not divided.
    ///
    /// All is weighed by the normal forces. The radius is that of the circle over which Hertz's pressure, p ∝ √(1 − r²/a²), has the same mean square
    /// distance from its middle: 2 a² / 5; but at least that of a circle as large as a cell's face, for a single point has no extent of its own, but moves
    /// what it hangs on.
    pub fn of(
        contacts: &[Contact],
        tissue: impl Fn(u8) -> Tissue,
        is_held: impl Fn(&Contact) -> bool,
        friction: f64,
        cell_m: f64,
    ) -> Option<Self> {
        let pressing = |contact: &Contact| contact.force_n.dot(&contact.normal).max(0.0);
        let total: f64 = contacts.iter().map(pressing).sum();
        // Written so that a NaN is no contact.
        let is_pressed = total > 0.0;
        if !is_pressed {
            return None;
        }
        let mean =
            |of: &dyn Fn(&Contact) -> f64| contacts.iter().map(|c| pressing(c) * of(c)).sum::<f64>() / total;
        let point_m = contacts.iter().map(|c| c.point_m * (pressing(c) / total)).sum::<Vec3>();
        let normal = push_direction(contacts.iter().map(|c| c.normal * -pressing(c)));
        let aside =
            |c: &Contact| (c.point_m - point_m - normal * normal.dot(&(c.point_m - point_m))).norm_squared();
        let held = |c: &Contact| if is_held(c) { 1.0 } else { 0.0 };
        // Contact answers to such a point's depth alone, and in proportion.
        let wall = |c: &Contact| held(c) * normal.dot(&c.normal).powi(2) * pressing(c) / c.depth_m;
        let dragging = contacts.iter().map(|c| c.force_n - c.normal * pressing(c)).sum::<Vec3>();
        Some(Self {
            point_m,
            normal,
            radius_m: (2.5 * mean(&aside)).sqrt().max(cell_m / PI.sqrt()),
            tissue: Tissue {
                young_pa: mean(&|c| tissue(c.material).young_pa),
                poisson: mean(&|c| tissue(c.material).poisson),
                relaxation_s: mean(&|c| (1.0 - held(c)) * tissue(c.material).relaxation_s),
                density_kg_m3: mean(&|c| tissue(c.material).density_kg_m3),
            },
            wall_n_per_m: contacts.iter().filter(|c| pressing(c) > 0.0 && c.depth_m > 0.0).map(wall).sum(),
            wall_share: mean(&held),
            cell_m,
            sticks: friction > 0.0 && dragging.norm() < SLIDING * friction * total,
        })
    }

    /// Whether nothing of it can move.
    pub fn is_wall(&self) -> bool {
        self.wall_share == 1.0
    }

    /// The stiffness that this contact has on a half-space, and that of what cannot move, about the tool's origin: 2 E* a along the normal and 8 G a / (2 − ν) across it,
    /// as that of a rigid circle of radius a (Johnson, "Contact Mechanics", 1985, chapters 3 and 7).
    pub fn stiffness(&self, origin: &Pose) -> Mat6 {
        let Tissue { young_pa, poisson, .. } = self.tissue;
        let plane_strain = young_pa / (1.0 - poisson * poisson);
        let shear = young_pa / (2.0 * (1.0 + poisson));
        let normal = 2.0 * plane_strain * self.radius_m;
        self.springs(origin, normal + self.wall_n_per_m, 8.0 * shear * self.radius_m / (2.0 - poisson))
    }

    /// What resists a tool that in a step of `step_s` seconds goes otherwise than in the last, in N/m about the tool's origin; the points of the contact move `mass_kg` at
    /// once. That resists by m / T², for the force that turns its velocity into the tool's acts as long as the step. It is half a cell deep, as a surface's nodes are in a
    /// lattice; by a step's end a wave has gone on from there, c T deep: a pressure wave for the way along the normal, a shear wave across it (Achenbach, "Wave Propagation in
    /// Elastic Solids", 1973, chapter 4). A row of masses, pulled at its end at a steady speed, has then taken up 2 x − 1 times as much as the first of them, where x = c T / h is above
    /// 1, and x² below, where only the first spring has answered.
    pub fn inertia(&self, origin: &Pose, step_s: f64, mass_kg: f64) -> Inertia {
        let Tissue { young_pa, poisson, density_kg_m3, .. } = self.tissue;
        let shear = young_pa / (2.0 * (1.0 + poisson));
        let pressure = 2.0 * shear * (1.0 - poisson) / (1.0 - 2.0 * poisson).max(LEAST_GIVE);
        let resists = mass_kg / (step_s * step_s);
        let wave = |modulus: f64| {
            let cells = (modulus / density_kg_m3).sqrt() * step_s / self.cell_m;
            resists * if cells < 1.0 { cells * cells } else { 2.0 * cells - 1.0 }
        };
        Inertia {
            cell: self.springs(origin, resists, resists),
            waves: self.springs(origin, wave(pressure), wave(shear)),
            around: Self { sticks: true, ..*self }.springs(origin, resists, resists),
        }
    }

    /// Springs that hold the contact, N/m along the normal and, where it sticks, across it, about the tool's origin.
    fn springs(&self, origin: &Pose, normal: f64, tangential: f64) -> Mat6 {
        let tangential = if self.sticks { tangential } else { 0.0 };
        let along = self.normal * self.normal.transpose();
        let springs = along * normal + (Mat3::identity() - along) * tangential;
        // The springs hold a point of the tool, an arm away from its origin: it moves by u + θ × r, and turns the tool by r × f.
        let arm = (self.point_m - origin.translation.vector).cross_matrix();
        let mut stiffness = Mat6::zeros();
        stiffness.fixed_view_mut::<3, 3>(0, 0).copy_from(&springs);
        stiffness.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-springs * arm));
        stiffness.fixed_view_mut::<3, 3>(3, 0).copy_from(&(arm * springs));
        stiffness.fixed_view_mut::<3, 3>(3, 3).copy_from(&(-arm * springs * arm));
        stiffness
    }
}

#[cfg(test)]
mod tests {
    use super::super::contact_model::stiffness_along;
    use super::*;
    use crate::math::Vec6;

    const SOFT: Tissue = Tissue { young_pa: 5e3, poisson: 0.45, relaxation_s: 0.0, density_kg_m3: 1000.0 };

    /// A flat tip of 5 mm on E* = 12.5 kPa, incompressible.
    fn patch() -> Patch {
        Patch {
            point_m: Vec3::zeros(),
            normal: Vec3::z(),
            radius_m: 5e-3,
            tissue: Tissue {
                young_pa: 12.5e3 * 0.75,
                poisson: 0.5,
                relaxation_s: 0.0,
                density_kg_m3: 1000.0,
            },
            sticks: true,
            cell_m: 0.0,
            wall_n_per_m: 0.0,
            wall_share: 0.0,
        }
    }

    /// Hertz's pressure over a circle of 4 mm at (0.1, 0, 0), 2 N in all, with the tool above and dragged along x by a share of it.
    fn hertzian(drag: f64) -> Vec<Contact> {
        let (radius, count) = (4e-3, 40);
        let at = |i: i32| radius * f64::from(i) / f64::from(count);
        let grid = (-count..=count).flat_map(|i| (-count..=count).map(move |j| (at(i), at(j))));
        let points: Vec<_> =
            grid.map(|(x, y)| (x, y, (1.0 - (x * x + y * y) / (radius * radius)).max(0.0).sqrt())).collect();
        let total: f64 = points.iter().map(|(_, _, pressure)| pressure).sum();
        let contact = |&(x, y, pressure): &(f64, f64, f64)| Contact {
            point_m: Vec3::new(0.1 + x, y, 0.0),
            normal: -Vec3::z(),
            depth_m: 1e-3,
            force_n: Vec3::new(drag, 0.0, -1.0) * (2.0 * pressure / total),
            material: if x < 0.0 { 1 } else { 2 },
            vertices: [0; 3],
            shares: [1.0, 0.0, 0.0],
        };
        points.iter().map(contact).collect()
    }

    fn free(_: &Contact) -> bool {
        false
    }

    #[test]
    fn the_stiffness_is_that_of_a_punch_on_a_half_space() {
        let stiffness = patch().stiffness(&Pose::identity());
        assert!((stiffness_along(&stiffness, Vec3::z()) - 125.0).abs() < 1e-9, "2 E* a");
        // 8 G a ÷ (2 − ν) with G = E ÷ 3.
        let tangential = 8.0 * (12.5e3 * 0.75 / 3.0) * 5e-3 / 1.5;
        assert!((stiffness_along(&stiffness, Vec3::x()) - tangential).abs() < 1e-9);
        let slippery = Patch { sticks: false, ..patch() }.stiffness(&Pose::identity());
        assert_eq!(stiffness_along(&slippery, Vec3::x()), 0.0);
    }

    #[test]
    fn a_contact_away_from_the_origin_resists_turning() {
        // 50 mm below the origin: turning about y by θ moves the contact by −0.05 θ along x.
        let stiffness = patch().stiffness(&Pose::translation(0.0, 0.0, 0.05));
        let tangential = stiffness_along(&stiffness, Vec3::x());
        let torque = -(stiffness * Vec6::new(0.0, 0.0, 0.0, 0.0, 1.0, 0.0));
        assert!((torque.x - 0.05 * tangential).abs() < 1e-9, "the contact is pushed back: {torque}");
        assert!((torque.a + 0.05 * 0.05 * tangential).abs() < 1e-9, "{torque}");
        assert!((stiffness - stiffness.transpose()).norm() < 1e-9 * stiffness.norm());
    }

    #[test]
    fn points_of_a_hertzian_contact_give_its_circle() {
        let tissue = |material| match material {
            1 => Tissue { young_pa: 4e3, poisson: 0.4, relaxation_s: 1e-3, density_kg_m3: 900.0 },
            _ => Tissue { young_pa: 6e3, poisson: 0.48, relaxation_s: 3e-3, density_kg_m3: 1100.0 },
        };
        let found = Patch::of(&hertzian(0.0), tissue, free, 0.0, 1e-3).unwrap();
        assert!((found.radius_m - 4e-3).abs() < 0.02 * 4e-3, "{found:?}");
        assert!((found.point_m - Vec3::x() * 0.1).norm() < 1e-9 && found.normal == Vec3::z(), "{found:?}");
        // A line of points more on one half than on the other.
        let Tissue { young_pa, poisson, relaxation_s, density_kg_m3 } = found.tissue;
        assert!((young_pa - 5e3).abs() < 30.0 && (poisson - 0.44).abs() < 2e-3, "{found:?}");
        assert!((relaxation_s - 2e-3).abs() < 5e-5 && (density_kg_m3 - 1000.0).abs() < 3.0, "{found:?}");
    }

    #[test]
    fn a_contact_is_as_heavy_as_its_nodes_and_what_waves_take_up_in_a_step() {
        // 5 kPa, ν 0.45: M = 18.97 kPa and G = 1.724 kPa; waves of 4.355 and 1.313 m/s.
        let (mass, cell) = (2e-3, 3e-3);
        let patch = Patch { tissue: SOFT, cell_m: cell, ..patch() };
        for step in [0.2e-3, 1e-3, 4e-3] {
            let Inertia { cell: nodes, waves, .. } = patch.inertia(&Pose::identity(), step, mass);
            for (axis, speed) in [(Vec3::z(), 4.355), (Vec3::x(), 1.313)] {
                assert!((stiffness_along(&nodes, axis) * step * step / mass - 1.0).abs() < 1e-12);
                let expected = row_of_masses(speed * step / cell);
                let found = stiffness_along(&waves, axis) * step * step / mass;
                assert!((found - expected).abs() < 0.15 * (1.0 + expected), "{found} {expected}");
            }
        }
        let slippery = Patch { sticks: false, ..patch }.inertia(&Pose::identity(), 1e-3, mass);
        let along =
            [slippery.cell, slippery.waves, slippery.around].map(|of| stiffness_along(&of, Vec3::x()));
        assert_eq!(along, [0.0, 0.0, mass / (1e-3 * 1e-3)], "what slides is met by its next normal alone");
        let incompressible = Patch { tissue: Tissue { poisson: 0.5, ..SOFT }, ..patch };
        assert!(incompressible.inertia(&Pose::identity(), 1e-3, mass).waves.iter().all(|x| x.is_finite()));
    }

    /// Momentum that a row of unit masses on unit springs has taken up, beyond the first's, when that one has been moved at unit speed for a time; the first
    /// mass is half of the others, so in its measure twice as much.
    fn row_of_masses(time: f64) -> f64 {
        let (mut at, mut speed, steps) = ([0.0_f64; 60], [0.0; 60], 20_000);
        let dt = time / f64::from(steps);
        for step in 0..steps {
            at[0] = f64::from(step) * dt;
            for i in 1..59 {
                speed[i] += dt * (at[i - 1] - 2.0 * at[i] + at[i + 1]);
            }
            (1..59).for_each(|i| at[i] += dt * speed[i]);
        }
        2.0 * speed.iter().sum::<f64>()
    }

    #[test]
    fn a_single_point_is_as_stiff_as_the_smallest_contact() {
        let point = Contact { force_n: -Vec3::z(), ..hertzian(0.0)[0] };
        let cell_m = 2e-3 * PI.sqrt();
        let found = Patch::of(&[point], |_| SOFT, free, 0.3, cell_m).unwrap();
        let stiffness = stiffness_along(&found.stiffness(&Pose::identity()), Vec3::z());
        assert!((stiffness - 2.0 * 5e3 / (1.0 - 0.45 * 0.45) * 2e-3).abs() < 1e-9, "2 E* a: {stiffness}");
        // Where points make a larger circle, that is the contact's.
        assert!(Patch::of(&hertzian(0.0), |_| SOFT, free, 0.3, cell_m).unwrap().radius_m > 3.9e-3);
    }

    #[test]
    fn points_that_cannot_move_are_as_stiff_as_they_answer_and_have_no_viscosity() {
        let viscous = |_| Tissue { relaxation_s: 1e-3, ..SOFT };
        let points = hertzian(0.0);
        let soft = Patch::of(&points, viscous, free, 0.0, 1e-3).unwrap();
        let wall = Patch::of(&points, viscous, |_| true, 0.0, 1e-3).unwrap();
        let along = |patch: &Patch| stiffness_along(&patch.stiffness(&Pose::identity()), Vec3::z());
        // 2 N over a depth of 1 mm.
        assert!((along(&wall) - along(&soft) - 2000.0).abs() < 1e-6);
        assert!(wall.is_wall() && !soft.is_wall() && wall.tissue.relaxation_s == 0.0);
        let half = Patch::of(&points, viscous, |c| c.material == 1, 0.0, 1e-3).unwrap();
        assert!(!half.is_wall() && (half.wall_share - 0.5).abs() < 0.02, "{half:?}");
    }

    #[test]
    fn a_contact_sticks_inside_the_cone_of_friction() {
        let sticks = |drag: f64, friction: f64| {
            Patch::of(&hertzian(drag), |_| SOFT, free, friction, 0.0).unwrap().sticks
        };
        assert!(sticks(0.2, 0.3) && !sticks(0.3, 0.3) && !sticks(0.0, 0.0));
    }

    #[test]
    fn nothing_that_pushes_is_no_contact() {
        assert_eq!(Patch::of(&[], |_| SOFT, free, 0.0, 1e-3), None);
        let still: Vec<_> =
            hertzian(0.0).into_iter().map(|c| Contact { force_n: Vec3::zeros(), ..c }).collect();
        assert_eq!(Patch::of(&still, |_| SOFT, free, 0.0, 1e-3), None);
        let lost = Contact { force_n: Vec3::repeat(f64::NAN), ..still[0] };
        assert_eq!(Patch::of(&[lost], |_| SOFT, free, 0.0, 1e-3), None);
    }
}
