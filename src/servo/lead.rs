//! How a proxy's tool is led through tissue that has mass.
//!
//! A step of the simulation takes what lies under a tool to where the tool ends, whatever that takes: against a change of way tissue resists by m / T², often
//! many times what it resists with at rest. A proxy that does not know strikes it like a hammer; one that is told strikes it all the same where the next
//! step is under way before it hears, for then tissue as stiff as its spring answers a step late.
//!
//! So the tool hangs on a second spring, here, where nothing is late: between where the servo asks it to be and where the tissue's mass lets it go, balanced for the
//! end of each step. It pulls against inertia alone, so that a tool at rest is where it was asked to be. What it pulled with is then left out of the model, since a servo that
//! hears of a blow has no more to do about it, and is told instead what the next step will take: all that is yet to come, and nothing twice.
//!
//! The mass is met along every way, although without friction it is felt along the normal alone. The next step's normal is not this one's: on the facets of a coarse surface a tool that
//! was free to slide half a millimetre would meet the next facet with that speed, and take what it gave there for the tissue's own, step by step.
//!
//! However heavy the tissue is, the answer to an asked place changes by no more than that spring, K_s, for each metre. The proxy balances it against the coupling, K_vc, and
//! moves by K_s / (K_vc + K_s) of what the last place was wrong by: every echo is weaker than what it answers, however late it comes (the small-gain theorem; Zames
//! 1966), as long as the mass on the spring, which nothing need damp, does not swing in step with its echoes. With half of the coupling's stiffness it comes to rest 8
//! steps late as well as at once, where it was taken for 0.6 to 1.5 times of what it is; with all of it not from 6 on. Steps follow each other, so that one model is late by one
//! or two.

use nalgebra::Cholesky;

use super::coupling::{LEVER_M, STIFFEST_N_PER_M, VirtualCoupling};
use super::impedance::{angular, displacement, isotropic, linear};
use super::patch::Inertia;
use crate::math::{Mat6, Pose, Quat, Vec6};
use crate::solver::tool::ToolMotion;

/// The spring as a share of the coupling's: with all of it, late echoes go on.
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
    inertia: Inertia,
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

    /// The tool has gone a way in the last step, and touches tissue of this inertia. Gives what it took to turn the tissue's way into the tool's; tissue that was not touched before
    /// is taken to have stood.
    pub fn touch(&mut self, inertia: &Inertia, way: &Vec6) -> Vec6 {
        let before = self.touched.as_ref().map_or(Vec6::zeros(), |touched| touched.way);
        // The spring makes it definite; an inertia that is not finite leads nothing.
        let factor = Cholesky::new(self.spring + inertia.around + inertia.waves);
        self.touched = factor.map(|factor| Touched { inertia: *inertia, way: *way, factor });
        match &self.touched {
            Some(_) => inertia.cell * (way - before) + inertia.waves * way,
            None => Vec6::zeros(),
        }
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
                let gone =
                    touched.factor.solve(&(self.spring * wished + touched.inertia.around * touched.way));
                let turned = Quat::from_scaled_axis(angular(&gone)) * from.rotation;
                (gone, Pose::from_parts((from.translation.vector + linear(&gone)).into(), turned))
            }
        };
        ToolMotion { pose, linear_m_s: linear(&gone) / step_s, angular_rad_s: angular(&gone) / step_s }
    }

    /// The tool's way in the last step; what the spring pulls it back with in the next if it is asked to stop; and with how much more for each metre that it is
    /// asked to go: spring and inertia in series. `None` where it touches nothing.
    pub fn resistance(&self) -> Option<(Vec6, Vec6, Mat6)> {
        let touched = self.touched.as_ref()?;
        let series = self.spring - self.spring * touched.factor.solve(&self.spring);
        let stops = self.spring * touched.factor.solve(&(touched.inertia.around * touched.way));
        Some((touched.way, stops, (series + series.transpose()) / 2.0))
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
        Inertia { cell, waves: cell, around: cell }
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
                let (mut lead, Inertia { cell, waves, around }) = (Lead::new(&coupling), dragged(mass_kg));
                let way = Vec6::new(1e-4, 0.0, -3e-4, 0.0, 1e-3, 0.0);
                lead.touch(&Inertia { cell, waves, around }, &way);
                let blow = |asked: &Vec6| {
                    let pose = Pose::new(linear(asked), angular(asked));
                    let gone =
                        displacement(&Pose::identity(), &lead.end(&Pose::identity(), &pose, STEP_S).pose);
                    (cell * (gone - way) + waves * gone, lead.spring * (asked - gone))
                };
                let asked = Vec6::new(-1e-3, 5e-4, 2e-3, 2e-3, 0.0, 1e-3);
                let ((felt, pull), (before, _)) = (blow(&asked), blow(&way));
                assert!((felt - pull).norm() < 1e-6 * felt.norm(), "{felt} {pull}");
                let (last, stopping, told) = lead.resistance().unwrap();
                let (stopped, _) = blow(&Vec6::zeros());
                assert!((stopped + stopping).norm() < 1e-6 * stopping.norm(), "{stopped} {stopping}");
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
        let cell = resists(taken_for_kg);
        let taken_for = Inertia { cell, waves: Mat6::zeros(), around: cell };
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
            let lasting = wrench(&(felt + lead.touch(&taken_for, &way)));
            let (way, stopping, resistance) = lead.resistance().unwrap();
            let model = ContactModel { wrench: lasting, motion: tool, ..ContactModel::none() };
            models.push(model.going_on(&way, &stopping, &resistance));
            most = most.max((proxy.motion().pose.translation.z + 2e-3).abs());
        }
        [most, (proxy.motion().pose.translation.z + 2e-3).abs()]
    }

    #[test]
    fn a_proxy_that_hears_late_comes_to_rest_on_a_mass_however_heavy_and_taken_for_less_or_more() {
        for taken_for in [0.6, 1.0, 1.5] {
            for mass_kg in (0..40).map(|i| 1e-5 * 1.3_f64.powi(i)) {
                for steps_late in 0..=8 {
                    let [most, last] = drags(mass_kg, taken_for * mass_kg, steps_late);
                    // The way that it began with, and never more.
                    let is_calm = most < 2e-3 && last < 0.5 * 2e-3;
                    assert!(is_calm, "{mass_kg} kg × {taken_for}, {steps_late} late: {most} {last}");
                }
            }
        }
    }
}
