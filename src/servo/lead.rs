//! How a proxy's tool is led through tissue that has mass.
//!
//! A step of the simulation takes what lies under a tool to where the tool ends, whatever that takes: against a change of way tissue resists by m / T², often
//! many times what it resists with at rest. A proxy that does not know strikes it like a hammer; one that is told strikes it all the same where the next
//! step is under way before it hears, for then tissue as stiff as its spring answers a step late.
//!
//! So the tool hangs on a second spring, here, where nothing is late: between where the servo asks it to be and where the tissue's mass lets it go, balanced for the
//! end of each step. It pulls against inertia alone, so that a tool at rest is where it was asked to be. Then, however heavy the tissue
//! is, the answer to an asked place changes by no more than that spring, K_s, for each metre. The proxy balances it against the coupling, K_vc, and moves by
//! K_s / K_vc of what the last place was wrong by: with a spring softer than the coupling's every echo is weaker than what it answers, however late it comes.
//! That alone would be enough where tissue only resists (the small-gain theorem; Zames 1966). A mass also swings on the spring, and nothing need damp it: with half
//! of the coupling's stiffness it comes to rest up to 6 steps late, or 4 where it was taken for 0.6 of what it is; with 1.5 times it would not from 4 on. Steps
//! follow each other, so that one model is late by one or two.

use nalgebra::Cholesky;

use super::coupling::{LEVER_M, STIFFEST_N_PER_M, VirtualCoupling};
use super::impedance::{angular, displacement, isotropic, linear};
use super::patch::Inertia;
use crate::math::{Mat6, Pose, Quat, Vec6};
use crate::solver::tool::ToolMotion;

/// The spring as a share of the coupling's: below 1, or a blow would echo for ever.
const SHARE: f64 = 0.5;

/// Leads the tool of one proxy.
#[derive(Clone, Debug)]
pub struct Lead {
    spring: Mat6,
    touched: Option<Touched>,
}

/// What a tool meets that goes another way than its last.
#[derive(Clone, Copy, Debug)]
struct Touched {
    /// What the cell under the tool, which goes on as in the last step, pulls the tool on with.
    goes_on: Vec6,
    /// The tool's way in the last step.
    way: Vec6,
    /// Of spring and inertia together.
    factor: Cholesky<f64, nalgebra::U6>,
}

impl Lead {
    /// For a proxy on this coupling. One that turns with its device turns as it is asked.
    pub fn new(coupling: &VirtualCoupling) -> Self {
        let turning = match coupling.stiffness_n_m_per_rad {
            0.0 => STIFFEST_N_PER_M * LEVER_M * LEVER_M,
            stiffness => SHARE * stiffness,
        };
        Self { spring: isotropic(SHARE * coupling.stiffness_n_per_m, turning), touched: None }
    }

    /// The tool has gone a way in the last step, and touches tissue of this inertia.
    pub fn touch(&mut self, inertia: &Inertia, way: &Vec6) {
        // The spring makes it definite; an inertia that is not finite leads nothing.
        let factor = Cholesky::new(self.spring + inertia.cell + inertia.waves);
        self.touched = factor.map(|factor| Touched { goes_on: inertia.cell * way, way: *way, factor });
    }

    /// The tool touches nothing.
    pub fn let_go(&mut self) {
        self.touched = None;
    }

    /// Where a tool that is asked to be somewhere ends a step of `step_s` seconds that begins at `from`, and how fast it goes there: a proxy's own velocity is that of
    /// a massless thing in the hand's time.
    pub fn end(&self, from: &Pose, asked: &Pose, step_s: f64) -> ToolMotion {
        let wished = displacement(from, asked);
        let (gone, pose) = match &self.touched {
            None => (wished, *asked),
            Some(touched) => {
                let gone = touched.factor.solve(&(self.spring * wished + touched.goes_on));
                let turned = Quat::from_scaled_axis(angular(&gone)) * from.rotation;
                (gone, Pose::from_parts((from.translation.vector + linear(&gone)).into(), turned))
            }
        };
        ToolMotion { pose, linear_m_s: linear(&gone) / step_s, angular_rad_s: angular(&gone) / step_s }
    }

    /// The tool's way in the last step, and what it meets for each metre that it is asked to go beyond that in the next: spring and inertia in series. `None`
    /// where it touches nothing.
    pub fn resistance(&self) -> Option<(Vec6, Mat6)> {
        let touched = self.touched.as_ref()?;
        let series = self.spring - self.spring * touched.factor.solve(&self.spring);
        Some((touched.way, (series + series.transpose()) / 2.0))
    }
}

#[cfg(test)]
mod tests {
    use super::super::contact_model::ContactModel;
    use super::super::coupling::Proxy;
    use super::super::device::DeviceDesc;
    use super::super::impedance::wrench;
    use super::*;
    use crate::math::{Mat3, Vec3};

    const STEP_S: f64 = 1e-3;

    fn touch() -> VirtualCoupling {
        VirtualCoupling::of(&DeviceDesc::touch())
    }

    /// A point of the tool, 20 mm aside, that drags a mass along all axes, and as much that waves carry away.
    fn dragged(mass_kg: f64) -> Inertia {
        let resists = mass_kg / (STEP_S * STEP_S);
        let mut cell = Mat6::zeros();
        let arm = Vec3::new(0.0, 0.02, 0.0).cross_matrix();
        cell.fixed_view_mut::<3, 3>(0, 0).copy_from(&Mat3::from_diagonal_element(resists));
        cell.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-arm * resists));
        cell.fixed_view_mut::<3, 3>(3, 0).copy_from(&(arm * resists));
        cell.fixed_view_mut::<3, 3>(3, 3).copy_from(&(-arm * arm * resists));
        Inertia { cell, waves: cell }
    }

    #[test]
    fn a_tool_that_touches_nothing_or_stays_is_where_it_was_asked_to_be() {
        let mut lead = Lead::new(&touch());
        let asked = Pose::new(Vec3::new(1e-3, -2e-3, 0.0), Vec3::new(0.0, 0.01, 0.0));
        for _ in 0..2 {
            assert!(lead.resistance().is_none());
            let free = lead.end(&Pose::identity(), &asked, STEP_S);
            assert_eq!((free.pose, free.linear_m_s), (asked, Vec3::new(1.0, -2.0, 0.0)));
            lead.touch(&dragged(5e-3), &Vec6::zeros());
            let missed = displacement(&asked, &lead.end(&asked, &asked, STEP_S).pose);
            assert!(missed.norm() < 1e-12, "{missed}");
            lead.let_go();
        }
    }

    #[test]
    fn a_blow_is_what_the_spring_pulls_with_and_its_change_what_the_servo_is_told() {
        let turning = VirtualCoupling { stiffness_n_m_per_rad: 1.0, ..touch() };
        for coupling in [touch(), turning] {
            for mass_kg in [1e-5, 3e-3, 1.0] {
                let (mut lead, Inertia { cell, waves }) = (Lead::new(&coupling), dragged(mass_kg));
                let way = Vec6::new(1e-4, 0.0, -3e-4, 0.0, 1e-3, 0.0);
                lead.touch(&Inertia { cell, waves }, &way);
                let blow = |asked: &Vec6| {
                    let pose = Pose::new(linear(asked), angular(asked));
                    let gone =
                        displacement(&Pose::identity(), &lead.end(&Pose::identity(), &pose, STEP_S).pose);
                    (cell * (gone - way) + waves * gone, lead.spring * (asked - gone))
                };
                let asked = Vec6::new(-1e-3, 5e-4, 2e-3, 2e-3, 0.0, 1e-3);
                let ((felt, pull), (before, _)) = (blow(&asked), blow(&way));
                assert!((felt - pull).norm() < 1e-6 * felt.norm(), "{felt} {pull}");
                let (last, told) = lead.resistance().unwrap();
                let expected = told * (asked - last);
                assert!((felt - before - expected).norm() < 1e-6 * felt.norm(), "{felt} {before} {expected}");
                let values = told.symmetric_eigenvalues();
                assert!(values.min() > -1e-9 * values.max(), "{values}");
                let block = told.fixed_view::<3, 3>(0, 0).into_owned().symmetric_eigenvalues();
                assert!(block.max() <= SHARE * coupling.stiffness_n_per_m * (1.0 + 1e-9), "{block}");
            }
        }
    }

    /// A proxy 2 mm before a mass that its tool drags, whose models it sees some steps late: how far the proxy ever is from its device, and is at the end, in m.
    fn drags(mass_kg: f64, taken_for_kg: f64, steps_late: usize) -> [f64; 2] {
        let (desc, coupling) = (DeviceDesc::touch(), touch());
        let device = ToolMotion::at(Pose::translation(0.0, 0.0, -2e-3));
        let mut proxy = Proxy::new(&coupling, &desc, &ToolMotion::at(Pose::identity()));
        let mut lead = Lead::new(&coupling);
        let resists = |mass_kg: f64| isotropic(mass_kg / (STEP_S * STEP_S), 0.0);
        // The worst of tissue: nothing of it is carried away.
        let taken_for = Inertia { cell: resists(taken_for_kg), waves: Mat6::zeros() };
        lead.touch(&taken_for, &Vec6::zeros());
        let mut models = vec![ContactModel::none(); steps_late + 1];
        let (mut at, mut before, mut most) = (Pose::identity(), Vec6::zeros(), 0.0_f64);
        for _ in 0..1000 {
            proxy.advance(&models[models.len() - 1 - steps_late], &device, STEP_S);
            let tool = lead.end(&at, &proxy.motion().pose, STEP_S);
            let way = displacement(&at, &tool.pose);
            // What it takes to change the mass's way.
            let felt = -resists(mass_kg) * (way - before);
            (at, before) = (tool.pose, way);
            lead.touch(&taken_for, &way);
            let (way, resistance) = lead.resistance().unwrap();
            let model = ContactModel { wrench: wrench(&felt), motion: tool, ..ContactModel::none() };
            models.push(model.going_on(&way, &resistance));
            most = most.max((proxy.motion().pose.translation.z + 2e-3).abs());
        }
        [most, (proxy.motion().pose.translation.z + 2e-3).abs()]
    }

    #[test]
    fn a_proxy_that_hears_late_comes_to_rest_on_a_mass_however_heavy_and_taken_for_less() {
        for (taken_for, latest) in [(1.0, 6), (0.6, 4)] {
            for mass_kg in (0..40).map(|i| 1e-5 * 1.3_f64.powi(i)) {
                for steps_late in 0..=latest {
                    let [most, last] = drags(mass_kg, taken_for * mass_kg, steps_late);
                    // The way that it began with, and never more.
                    let is_calm = most < 2e-3 && last < 0.5 * 2e-3;
                    assert!(is_calm, "{mass_kg} kg × {taken_for}, {steps_late} late: {most} {last}");
                }
            }
        }
    }
}
