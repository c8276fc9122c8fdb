//! A camera that places itself so that all it is shown fits into a part of the picture.

use palpate::math::Vec3;

/// A part of a picture in pixels: left, top, width, height.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    /// Left edge.
    pub left: f64,
    /// Upper edge.
    pub top: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

/// A camera in the world.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// Unit vector to the right of the picture.
    pub right: Vec3,
    /// Unit vector to the top of the picture.
    pub up: Vec3,
    /// Unit vector out of the picture, towards the viewer.
    pub back: Vec3,
    eye: Vec3,
    /// Pixels per unit of tangent (perspective) or per metre (parallel).
    scale: f64,
    centre: [f64; 2],
    is_parallel: bool,
}

/// Half of the larger opening angle of a perspective camera, as a tangent.
const TANGENT: f64 = 0.27;

impl Camera {
    /// A perspective camera that looks from the side `back` is on, with `up` upwards.
    pub fn perspective(back: Vec3, up: Vec3, points: &[Vec3], window: Window) -> Self {
        let [right, up, back] = axes(back, up);
        let scale = window.width.max(window.height) / 2.0 / TANGENT;
        let tangents = [window.width / 2.0 / scale, window.height / 2.0 / scale];

        // A point is in view when |across| ≤ tangent · distance on both axes. Both bounds of an axis meet at the nearest eye.
        let place = |axis: Vec3, tangent: f64| {
            let most = |sign: f64| {
                points.iter().map(|p| sign * p.dot(&axis) + tangent * p.dot(&back)).fold(f64::MIN, f64::max)
            };
            let [plus, minus] = [most(1.0), most(-1.0)];
            [(plus - minus) / 2.0, (plus + minus) / (2.0 * tangent)]
        };
        let [x, from_x] = place(right, tangents[0]);
        let [y, from_y] = place(up, tangents[1]);
        let eye = right * x + up * y + back * from_x.max(from_y);

        Self { right, up, back, eye, scale, centre: middle(window), is_parallel: false }
    }

    /// A parallel camera, true to scale everywhere.
    pub fn parallel(back: Vec3, up: Vec3, points: &[Vec3], window: Window) -> Self {
        let [right, up, back] = axes(back, up);
        let range = |axis: Vec3| {
            points
                .iter()
                .fold([f64::MAX, f64::MIN], |[low, high], p| [low.min(p.dot(&axis)), high.max(p.dot(&axis))])
        };
        let ([x0, x1], [y0, y1], [_, near]) = (range(right), range(up), range(back));
        let scale = (window.width / (x1 - x0).max(1e-6)).min(window.height / (y1 - y0).max(1e-6));
        let eye = right * ((x0 + x1) / 2.0) + up * ((y0 + y1) / 2.0) + back * (near + 1.0);

        Self { right, up, back, eye, scale, centre: middle(window), is_parallel: true }
    }

    /// Pixel column, pixel row and distance in front of the camera.
    pub fn project(&self, point: Vec3) -> [f64; 3] {
        let seen = point - self.eye;
        let depth = -seen.dot(&self.back);
        let scale = if self.is_parallel { self.scale } else { self.scale / depth };
        [self.centre[0] + seen.dot(&self.right) * scale, self.centre[1] - seen.dot(&self.up) * scale, depth]
    }

    /// The point at a pixel and a distance: the inverse of [`Self::project`].
    pub fn point(&self, column: f64, row: f64, depth: f64) -> Vec3 {
        let [x, y] = [(column - self.centre[0]) / self.scale, (self.centre[1] - row) / self.scale];
        let spread = if self.is_parallel { 1.0 } else { depth };
        self.eye + (self.right * x + self.up * y) * spread - self.back * depth
    }

    /// Unit vector from a point to the viewer.
    pub fn towards(&self, point: Vec3) -> Vec3 {
        if self.is_parallel { self.back } else { (self.eye - point).normalize() }
    }

    /// Pixels that a metre across the view takes at a distance.
    pub fn pixels_per_metre(&self, depth: f64) -> f64 {
        if self.is_parallel { self.scale } else { self.scale / depth }
    }

    /// Whether depth, rather than its inverse, is linear across the picture.
    pub fn is_parallel(&self) -> bool {
        self.is_parallel
    }
}

fn axes(back: Vec3, up: Vec3) -> [Vec3; 3] {
    let back = back.normalize();
    let right = up.cross(&back).normalize();
    [right, back.cross(&right), back]
}

fn middle(window: Window) -> [f64; 2] {
    [window.left + window.width / 2.0, window.top + window.height / 2.0]
}
