//! Tools: what they feel against theory, and what they must never do.

use std::f64::consts::PI;
use std::sync::Arc;

use palpate::math::{Pose, Quat, Vec3};
use palpate::model::Model;
use palpate::sim::{Precision, SimDesc, ToolPort};
use palpate::solver::method::{EfgDesc, Method};
use palpate::solver::tool::{Shape, ToolDesc, ToolForce, ToolMotion};

use super::scene::{
    Body, block, dragged, ellipsoid, exact, hold, material, place, roller, step_to, touch_flat_top,
};
use super::tolerance::{self as tol, Claim};

// ---- Indentation of a half-space ---------------------------------

/// Cells of the quarter domain along each axis, 0.5 mm each: ten times the radius of contact.
const DOMAIN: usize = 60;
const FINE: f64 = 0.5e-3;
const YOUNG: f64 = 1e4;
/// Radius of contact, or half the width of a punch: six cells.
const REACH: f64 = 6.0 * FINE;
const HEIGHT: f64 = DOMAIN as f64 * FINE;

/// A quarter of a block on a rigid ground between frictionless walls.
fn quarter_space(poisson: f64) -> Arc<Model> {
    let mut build = block([DOMAIN; 3], FINE, material(YOUNG, poisson, 1000.0));
    roller(&mut build, 0);
    roller(&mut build, 1);
    for axis in 0..2 {
        let wall = |a: usize, free: f64| if a == axis { HEIGHT } else { free };
        let (low, high) = (Vec3::from_fn(|a, _| wall(a, -1.0)), Vec3::from_fn(|a, _| wall(a, 1.0)));
        hold(&mut build, low, high, std::array::from_fn(|a| a == axis));
    }
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    touch_flat_top(&mut build, [DOMAIN; 3], FINE);
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// Force on a frictionless tool over the whole half-space once all is at rest.
fn pressed(model: &Arc<Model>, tool: &ToolDesc, centre: f64, method: Method) -> f64 {
    let shear = model.materials()[0].shear_modulus_pa();
    let slowest = 0.5 * PI * (shear / 1000.0).sqrt() / HEIGHT;
    let (desc, steps) = match method {
        Method::Lattice => {
            let desc = SimDesc { precision: Precision::Single, step_s: 2e-3, ..dragged(2.0 * slowest) };
            (desc, (5.0 / slowest / 2e-3) as usize)
        }
        // Steps in which the slowest mode turns ten times leave a hundredth of its motion each.
        Method::Efg(_) => {
            let step_s = 10.0 / slowest;
            (SimDesc { method, precision: Precision::Single, step_s, ..exact() }, 3)
        }
    };
    let mut body = Body::of(model, &desc);
    let mut port = body.sim.add_tool(tool).unwrap();
    place(&mut port, Vec3::new(0.0, 0.0, HEIGHT + centre));
    body.steps(steps);
    4.0 * port.force().wrench.force_n.z
}

/// The meshless model, solved well.
fn meshless() -> Method {
    Method::Efg(EfgDesc { tolerance: 1e-4, max_iterations: 5000, ..EfgDesc::default() })
}

fn name_of(method: &Method) -> &'static str {
    match method {
        Method::Lattice => "lattice",
        Method::Efg(_) => "EFG",
    }
}

/// −α₀ of a bonded layer, Dimitriadis et al. (2002): to first order a force F sinks the surface by α F / (π E* H) less than it would a
/// half-space.
fn layer_alpha(poisson: f64) -> f64 {
    (1.2876 - 1.4678 * poisson + 1.3442 * poisson * poisson) / (1.0 - poisson)
}

#[test]
fn a_sphere_meets_the_force_of_hertz() {
    let mut claim = Claim::new("Hertz");
    for (poisson, methods) in [(0.25, vec![Method::Lattice]), (0.45, vec![Method::Lattice, meshless()])] {
        let (radius_m, depth) = (0.03, REACH * REACH / 0.03);
        let (model, ball) = (quarter_space(poisson), ToolDesc::sphere(radius_m));
        let forces: Vec<f64> =
            methods.iter().map(|&method| pressed(&model, &ball, radius_m - depth, method)).collect();

        // Hertz (1881), and the layer's finite height after Dimitriadis et al. (2002) for any ν, bonded.
        let modulus = YOUNG / (1.0 - poisson * poisson);
        let half_space = 4.0 / 3.0 * modulus * radius_m.sqrt() * depth.powf(1.5);
        let (alpha, x) = (-layer_alpha(poisson), REACH / HEIGHT);
        let beta = (0.6387 - 1.0277 * poisson + 1.5164 * poisson * poisson) / (1.0 - poisson);
        let layer = 1.0 - 2.0 * alpha / PI * x + (2.0 * alpha / PI * x).powi(2)
            - 8.0 / PI.powi(3) * (alpha.powi(3) + 4.0 * PI * PI / 15.0 * beta) * x.powi(3);
        for (method, found) in methods.iter().zip(&forces) {
            let name = format!(
                "{}, nu {poisson}, F / F_Hertz {:.3}, layer {layer:.3}",
                name_of(method),
                found / half_space
            );
            claim.check(tol::INDENTATION, &name, found / (half_space * layer) - 1.0);
        }
        if let [lattice, efg] = forces[..] {
            claim.check(tol::MODELS_AGREE, "one model beside the other", efg / lattice - 1.0);
        }
    }
}

#[test]
fn a_square_punch_meets_the_force_of_a_charged_plate() {
    let mut claim = Claim::new("flat punch");
    let (poisson, depth) = (0.25, 0.25e-3);
    let model = quarter_space(poisson);
    // The rounding lies outside six cells, where no contact point is before the next cell's.
    let rounding_m = 0.1e-3;
    let half = REACH + rounding_m;
    let shape = Shape::Box { half_extents_m: Vec3::new(half, half, 0.01), rounding_m };
    let tool = ToolDesc { parts: vec![(Pose::identity(), shape)], friction: 0.0, blade: None };
    // The pressure under a rigid frictionless punch is distributed as the charge on a conducting plate, F = π E* d C with the
    // capacitance C as a length: 2 a / π for a disc, which gives 2 E* a d, and 0.36679 times the side for a square (Read 1997).
    let modulus = YOUNG / (1.0 - poisson * poisson);
    let stiffness = PI * 0.36679 * 2.0 * REACH;
    let half_space = stiffness * modulus * depth;
    let layer = 1.0 / (1.0 - stiffness * layer_alpha(poisson) / (PI * HEIGHT));
    for method in [Method::Lattice, meshless()] {
        let found = pressed(&model, &tool, 0.01 - depth, method);
        let name = name_of(&method);
        let name = format!("{name}, F / F_half-space {:.3}, layer {layer:.3}", found / half_space);
        claim.check(tol::INDENTATION, &name, found / (half_space * layer) - 1.0);
    }
}

// ---- Laws of contact ---------------------------------------------

const H: f64 = 4e-3;
const TOP: f64 = 8.0 * H;

/// A block of 16 × 16 × 8 cells on a rigid ground, in steps of a millisecond.
fn slab(desc: &SimDesc) -> Body {
    let mut build = block([16, 16, 8], H, material(5e3, 0.45, 1000.0));
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    touch_flat_top(&mut build, [16, 16, 8], H);
    Body::new(&build, desc)
}

fn single(drag_per_s: f64) -> SimDesc {
    SimDesc { precision: Precision::Single, ..dragged(drag_per_s) }
}

/// The middle of the slab's top, moved along x, and this far above the top.
fn over(along: f64, height: f64) -> Vec3 {
    Vec3::new(8.0 * H + along, 8.0 * H, TOP + height)
}

/// Moves a tool along a straight way at constant speed and gives the forces of all steps.
fn glide(body: &mut Body, port: &mut ToolPort, from: Vec3, to: Vec3, steps: u32) -> Vec<ToolForce> {
    (1..=steps).map(|s| step_to(body, port, from + (to - from) * (f64::from(s) / f64::from(steps)))).collect()
}

fn compound(parts: Vec<(Pose, Shape)>) -> ToolDesc {
    ToolDesc { parts, friction: 0.3, blade: None }
}

#[test]
fn a_tool_receives_exactly_what_it_gives_to_the_tissue() {
    let mut claim = Claim::new("third law");
    for (precision, limit) in
        [(Precision::Single, tol::THIRD_LAW_F32), (Precision::Double, tol::THIRD_LAW_F64)]
    {
        let desc = SimDesc { precision, ..exact() };
        let mut body = Body::new(&ellipsoid([10, 8, 6], H, material(5e3, 0.45, 1000.0)), &desc);
        let capsule = Shape::Capsule { radius_m: 4e-3, half_length_m: 6e-3 };
        let slanted = Pose::from_parts(Vec3::zeros().into(), Quat::from_euler_angles(0.3, 1.2, 0.1));
        let mut port = body.sim.add_tool(&compound(vec![(slanted, capsule)])).unwrap();
        let (mut before, mut turning) = (body.momentum().0, body.angular_momentum().0);
        let (mut sum, mut off, mut turn_sum, mut turn_off) = (0.0, 0.0_f64, 0.0, 0.0_f64);
        for step in 0..60 {
            let at = Vec3::new(
                5.0 * H + 1e-4 * f64::from(step),
                4.5 * H,
                6.0 * H + 4e-3 - 1.5e-4 * f64::from(step),
            );
            let wrench = step_to(&mut body, &mut port, at).wrench;
            let (now, turn_now) = (body.momentum().0, body.angular_momentum().0);
            let (given, turned) = ((now - before) / 1e-3, (turn_now - turning) / 1e-3);
            (before, turning) = (now, turn_now);
            sum += wrench.force_n.norm();
            off = off.max((given + wrench.force_n).norm());
            // The torque about the world's origin: the tool's own, and its force at where it was, on average, in this step.
            let torque = wrench.torque_n_m + (at - Vec3::new(5e-5, 0.0, -7.5e-5)).cross(&wrench.force_n);
            turn_sum += torque.norm();
            turn_off = turn_off.max((turned + torque).norm());
        }
        assert!(sum > 0.1, "the tool pressed: {sum}");
        claim.check(limit, &format!("{precision:?}, force"), off / (sum / 60.0));
        claim.check(tol::TORQUE, &format!("{precision:?}, torque"), turn_off / (turn_sum / 60.0));
    }
}

#[test]
fn a_thin_tip_at_one_metre_a_second_does_not_pass_through_coarse_cells() {
    let mut claim = Claim::new("tunnelling");
    for (along, name) in [(0.0, "on a node"), (0.5 * H, "on an edge"), (0.3 * H, "inside a face")] {
        let mut body = slab(&SimDesc { sleeping: true, ..single(5.0) });
        let radius_m = 1e-3;
        let mut port = body.sim.add_tool(&ToolDesc::sphere(radius_m)).unwrap();
        place(&mut port, over(along, 5e-3));
        body.steps(1);
        // From 5 mm above to 8 mm below, two cells, in 13 ms.
        let (mut deepest, mut weakest) = (0.0_f64, f64::INFINITY);
        for step in 1..=13 {
            let tip = 5e-3 - 1e-3 * f64::from(step);
            let force = step_to(&mut body, &mut port, over(along, tip + radius_m));
            if tip < -0.5e-3 {
                weakest = weakest.min(force.wrench.force_n.z);
            }
            let hit =
                body.sim.pick(over(along, 0.1), -Vec3::z()).unwrap().expect("a ray from above meets the top");
            // How far the surface stands above the tip's lowest point.
            deepest = deepest.max((hit.point_m.z - TOP - tip) / radius_m);
        }
        claim.check(tol::TUNNELLING, &format!("{name}, how deep / radius"), deepest);
        assert!(weakest > 0.0, "{name}: the tip presses all the way, not with {weakest} N");
    }
}

#[test]
fn a_tool_that_only_touches_feels_nothing() {
    let mut body = slab(&single(5.0));
    let tools = [
        (ToolDesc::sphere(3e-3), 3e-3),
        (compound(vec![(Pose::identity(), Shape::Capsule { radius_m: 3e-3, half_length_m: 2e-3 })]), 5e-3),
        (
            compound(vec![(
                Pose::identity(),
                Shape::Box { half_extents_m: Vec3::repeat(3e-3), rounding_m: 1e-3 },
            )]),
            3e-3,
        ),
    ];
    for (tool, reach) in tools {
        let mut port = body.sim.add_tool(&tool).unwrap();
        let force = step_to(&mut body, &mut port, over(0.0, reach));
        assert_eq!(force.wrench.force_n, Vec3::zeros());
        assert_eq!(force.wrench.torque_n_m, Vec3::zeros());
        assert!(body.sim.contacts(port.id()).unwrap().is_empty());
        body.sim.remove_tool(port.id()).unwrap();
    }
    assert!(body.u().iter().all(|u| *u == Vec3::zeros()), "and moves nothing");
}

#[test]
fn a_slow_closed_loop_gives_no_energy_to_the_hand() {
    let mut claim = Claim::new("closed loop");
    for friction in [0.0, 0.5] {
        let mut body = slab(&single(60.0));
        let tool = ToolDesc { friction, ..ToolDesc::sphere(5e-3) };
        let mut port = body.sim.add_tool(&tool).unwrap();
        let corners = [
            over(-6e-3, 5.5e-3),
            over(-6e-3, 1e-3),
            over(6e-3, 1e-3),
            over(6e-3, 5.5e-3),
            over(-6e-3, 5.5e-3),
        ];
        let mut most = 0.0_f64;
        for way in corners.windows(2) {
            glide(&mut body, &mut port, way[0], way[1], 150);
            most = most.max(body.sim.energy().tool_work_j);
        }
        let work = body.sim.energy().tool_work_j;
        assert!(work >= 0.0, "friction {friction}: the loop gave {work:e} J away");
        claim.check(tol::LOOP_LOSS, &format!("friction {friction}, work kept / most"), work / most - 0.5);
    }
}

#[test]
fn friction_holds_below_its_cone_and_slides_on_it() {
    let mut claim = Claim::new("friction");
    let friction = 0.3;
    let mut body = slab(&single(60.0));
    // A plate larger than the slab: every contact is flat.
    let half_extents_m = Vec3::new(0.06, 0.06, 0.02);
    let plate = Shape::Box { half_extents_m, rounding_m: 1e-3 };
    let tool = ToolDesc { parts: vec![(Pose::identity(), plate)], friction, blade: None };
    let mut port = body.sim.add_tool(&tool).unwrap();
    glide(&mut body, &mut port, over(0.0, 0.02), over(0.0, 0.018), 200);
    glide(&mut body, &mut port, over(0.0, 0.018), over(0.0, 0.018), 100);

    // A little aside: the top goes along.
    let aside = 0.5e-3;
    glide(&mut body, &mut port, over(0.0, 0.018), over(aside, 0.018), 100);
    let force = glide(&mut body, &mut port, over(aside, 0.018), over(aside, 0.018), 100)[99].wrench.force_n;
    assert!(force.x < 0.0 && force.x.abs() < friction * force.z, "held: {force}");
    let top = body.mean_over_plane(2, TOP, &body.u()).x;
    claim.check(tol::STICKING, "motion of the top / of the tool", top / aside - 1.0);

    // Far aside: it slides, against the motion, on the cone.
    let far = 12e-3;
    let forces = glide(&mut body, &mut port, over(aside, 0.018), over(far, 0.018), 600);
    for force in forces[500..].iter().step_by(33).map(|f| f.wrench.force_n) {
        claim.check(tol::SLIDING, "tangential / (mu normal)", -force.x / (friction * force.z) - 1.0);
    }
}

#[test]
fn a_tip_smaller_than_a_cell_glides_over_the_cells() {
    let mut claim = Claim::new("cogging");
    for radius_m in [2e-3, 4e-3] {
        let mut body = slab(&single(60.0));
        let mut port = body.sim.add_tool(&ToolDesc::sphere(radius_m)).unwrap();
        let depth = radius_m - 2e-3;
        glide(&mut body, &mut port, over(-2.5 * H, radius_m), over(-2.5 * H, depth), 100);
        glide(&mut body, &mut port, over(-2.5 * H, depth), over(-2.0 * H, depth), 100);
        // Four cells, 20 mm/s.
        let forces = glide(&mut body, &mut port, over(-2.0 * H, depth), over(2.0 * H, depth), 800);
        let normal: Vec<f64> = forces.iter().map(|f| f.wrench.force_n.z).collect();
        let mean = normal.iter().sum::<f64>() / normal.len() as f64;
        let (low, high) = normal.iter().fold((f64::MAX, 0.0_f64), |(l, h), f| (l.min(*f), h.max(*f)));
        let along = forces.iter().map(|f| f.wrench.force_n.x.abs()).fold(0.0, f64::max);
        let name = format!("radius {} cells", radius_m / H);
        claim.check(
            tol::COGGING,
            &format!("{name}, (max - min) / (2 mean) normal"),
            (high - low) / (2.0 * mean),
        );
        claim.check(
            tol::COGGING_ALONG,
            &format!("{name}, largest force along the way / normal"),
            along / mean,
        );
        let jump = normal.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        claim.check(tol::COGGING_STEP, &format!("{name}, largest change in a step / mean"), jump / mean);
    }
}

#[test]
fn two_tools_pinch_a_free_body_in_balance() {
    let mut claim = Claim::new("pinch");
    let mut body = Body::new(&block([6; 3], H, material(5e3, 0.4, 1000.0)), &single(40.0));
    // Without friction a free body would sooner or later slip out, as a wet stone does.
    let tool = ToolDesc { friction: 0.5, ..ToolDesc::sphere(8e-3) };
    let mut ports = [0, 1].map(|_| body.sim.add_tool(&tool).unwrap());
    for step in 0..600 {
        let depth = 2e-3 * (f64::from(step) / 200.0).min(1.0);
        let away = 3.0 * H + 8e-3 - depth;
        for (port, side) in ports.iter_mut().zip([-1.0, 1.0]) {
            place(port, Vec3::new(3.0 * H + side * away, 3.0 * H, 3.0 * H));
        }
        body.steps(1);
    }
    let [left, right] = ports.each_mut().map(|port| port.force().wrench.force_n);
    assert!(left.x < -1e-3 && right.x > 1e-3, "both are pushed away: {left} {right}");
    claim.check(tol::PINCH, "sum of forces / force", (left + right).norm() / right.norm());
}

#[test]
fn a_compound_feels_the_sum_of_its_parts() {
    let mut claim = Claim::new("compound");
    let ball = Shape::Sphere { radius_m: 5e-3 };
    let at = |x: f64| Pose::translation(x, 0.0, 0.0);
    let mut whole = slab(&dragged(40.0));
    let mut port = whole.sim.add_tool(&compound(vec![(at(-0.014), ball), (at(0.014), ball)])).unwrap();
    let mut apart = slab(&dragged(40.0));
    let mut parts = [0, 1].map(|_| apart.sim.add_tool(&compound(vec![(Pose::identity(), ball)])).unwrap());
    let mut off = 0.0_f64;
    for step in 0..60 {
        let centre = over(0.0, 5e-3 - 4e-5 * f64::from(step));
        let one = step_to(&mut whole, &mut port, centre).wrench;
        for (part, x) in parts.iter_mut().zip([-0.014, 0.014]) {
            place(part, centre + Vec3::new(x, 0.0, 0.0));
        }
        apart.steps(1);
        let mut other = (Vec3::zeros(), Vec3::zeros());
        for (part, x) in parts.iter_mut().zip([-0.014, 0.014]) {
            let wrench = part.force().wrench;
            other.0 += wrench.force_n;
            other.1 += wrench.torque_n_m + Vec3::new(x, 0.0, 0.0).cross(&wrench.force_n);
        }
        let size = one.force_n.norm().max(1e-6);
        off = off.max((one.force_n - other.0).norm() / size);
        off = off.max((one.torque_n_m - other.1).norm() / (size * 0.014));
    }
    claim.check(tol::COMPOUND, "force and torque", off);
}

#[test]
fn a_capsule_without_length_and_a_box_of_rounding_alone_are_spheres() {
    let mut claim = Claim::new("degenerate shapes");
    let radius_m = 5e-3;
    let shapes = [
        Shape::Sphere { radius_m },
        Shape::Capsule { radius_m, half_length_m: 0.0 },
        Shape::Box { half_extents_m: Vec3::repeat(radius_m), rounding_m: radius_m },
    ];
    let forces = shapes.map(|shape| {
        let mut body = slab(&dragged(40.0));
        let mut port = body.sim.add_tool(&compound(vec![(Pose::identity(), shape)])).unwrap();
        glide(&mut body, &mut port, over(0.0, radius_m), over(1e-3, 3e-3), 40)[39].wrench.force_n
    });
    assert!(forces[0].z > 0.0);
    for (name, force) in ["capsule", "box"].iter().zip(&forces[1..]) {
        claim.check(tol::COMPOUND, name, (force - forces[0]).norm() / forces[0].norm());
    }
}

#[test]
fn long_tools_feel_the_torque_of_where_they_touch() {
    let mut claim = Claim::new("torque of long tools");
    let shapes = [
        Shape::Capsule { radius_m: 4e-3, half_length_m: 0.03 },
        Shape::Box { half_extents_m: Vec3::new(4e-3, 4e-3, 0.034), rounding_m: 2e-3 },
    ];
    for shape in shapes {
        let mut body = slab(&dragged(40.0));
        let mut port = body.sim.add_tool(&compound(vec![(Pose::identity(), shape)])).unwrap();
        // Lying along x, only its left part over the slab.
        let lying = Quat::from_axis_angle(&Vec3::y_axis(), 0.5 * PI);
        for step in 0..40 {
            let at = Vec3::new(16.0 * H, 8.0 * H, TOP + 4e-3 - 5e-5 * f64::from(step));
            port.set_motion(&ToolMotion::at(Pose::from_parts(at.into(), lying))).unwrap();
            body.steps(1);
        }
        let force = port.force();
        let origin = force.motion.pose.translation.vector;
        // The listed contacts are those of the last substep; shares of the force change little within a step.
        let contacts = body.sim.contacts(port.id()).unwrap();
        let sum: Vec3 = contacts.iter().map(|c| -c.force_n).sum();
        let torque: Vec3 = contacts.iter().map(|c| (c.point_m - origin).cross(&-c.force_n)).sum();
        assert!(contacts.iter().all(|c| c.material == 1 && c.depth_m >= 0.0 && c.normal.z < 0.0));
        assert!(force.wrench.torque_n_m.y > 0.0, "pushed up at its left end, it turns about +y");
        let (arm, listed) = (force.wrench.torque_n_m / force.wrench.force_n.norm(), torque / sum.norm());
        claim.check(tol::TORQUE_ARM, &format!("{shape:?}"), (arm - listed).norm() / listed.norm());
    }
}
