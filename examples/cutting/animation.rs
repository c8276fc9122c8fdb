//! A short animation of the cut.

use std::fs::File;
use std::path::Path;

use anyhow::Context;
use gif::{Encoder, Frame, Repeat};

use super::picture::{self, Moment};
use super::scene::{Scene, View};

/// Size of a picture in pixels.
const SIZE: [usize; 2] = [560, 420];
/// Hundredths of a second that each is shown.
const DELAY_CS: u16 = 8;
/// How finely colours are sought, 1 to 30, 1 being finest.
const SPEED: i32 = 10;

/// Moments at equal distances.
#[derive(Debug)]
pub struct Film {
    count: u32,
    moments: Vec<Moment>,
}

impl Film {
    /// Of so many pictures.
    pub fn new(count: u32) -> Self {
        Self { count, moments: Vec::new() }
    }

    /// Whether a picture is to be taken after this step.
    pub fn is_due(&self, step: u32, steps: u32) -> bool {
        u64::from(step) * u64::from(self.count) / u64::from(steps)
            > u64::from(step - 1) * u64::from(self.count) / u64::from(steps)
    }

    /// Takes one.
    pub fn shoot(&mut self, moment: Moment) {
        self.moments.push(moment);
    }

    /// Draws and writes them. `bounds` are moments that all must fit in with.
    pub fn write(&self, seen: (&Scene, &View), bounds: &[Moment], path: &Path) -> anyhow::Result<()> {
        if self.moments.is_empty() {
            return Ok(());
        }
        let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        let [width, height] = SIZE.map(|n| n as u16);
        let mut encoder = Encoder::new(file, width, height, &[])?;
        encoder.set_repeat(Repeat::Infinite)?;
        for moment in &self.moments {
            let canvas = picture::draw(seen, moment, bounds, SIZE)?;
            let mut frame = Frame::from_rgb_speed(width, height, &canvas.rgb(), SPEED);
            frame.delay = DELAY_CS;
            encoder.write_frame(&frame)?;
        }
        Ok(())
    }
}
