//! Colours: one for each tissue, and a ramp for quantities. Linear light, red green blue in [0, 1].

/// A colour in linear light.
pub type Colour = [f32; 3];

/// The tool.
pub const STEEL: Colour = [0.30, 0.36, 0.42];
/// Forces.
pub const FORCE: Colour = [0.95, 0.20, 0.02];

/// Tissues by a word in their name, with the look that an anatomy atlas gives them, in sRGB. The first word that fits counts.
const TISSUES: [(&str, [u8; 3]); 16] = [
    ("fat", [240, 208, 120]),
    ("muscle", [190, 82, 74]),
    ("myocardium", [176, 60, 64]),
    ("heart", [176, 60, 64]),
    ("liver", [142, 62, 48]),
    ("vessel", [72, 104, 178]),
    ("artery", [204, 40, 48]),
    ("aorta", [204, 40, 48]),
    ("lung", [231, 164, 160]),
    ("tumour", [108, 148, 70]),
    ("skin", [226, 178, 148]),
    ("brain", [214, 178, 168]),
    ("bone", [238, 232, 214]),
    ("airway", [150, 196, 204]),
    ("blood", [164, 28, 40]),
    ("spleen", [118, 58, 82]),
];

/// Colours for tissues that are not in the list, in sRGB.
const OTHERS: [[u8; 3]; 5] =
    [[128, 160, 150], [170, 140, 180], [196, 150, 96], [110, 140, 170], [150, 150, 110]];

/// Stops of the ramp in sRGB: light grey where nothing moves, then warmer and darker.
const RAMP: [[u8; 3]; 6] =
    [[224, 222, 216], [246, 216, 128], [242, 154, 66], [214, 74, 58], [140, 30, 92], [58, 16, 84]];

/// The colour of a material by its name and its index, 1 to 15.
pub fn of_material(name: &str, index: usize) -> Colour {
    let name = name.to_lowercase();
    let known = TISSUES.iter().find(|(word, _)| name.contains(word)).map(|(_, colour)| *colour);
    known.unwrap_or(OTHERS[index % OTHERS.len()]).map(to_linear)
}

/// The colour of a quantity scaled to [0, 1].
pub fn of_quantity(value: f32) -> Colour {
    let place = value.clamp(0.0, 1.0) * (RAMP.len() - 1) as f32;
    let stop = (place as usize).min(RAMP.len() - 2);
    mix(RAMP[stop].map(to_linear), RAMP[stop + 1].map(to_linear), place - stop as f32)
}

/// `a` at 0, `b` at 1.
pub fn mix(a: Colour, b: Colour, share: f32) -> Colour {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * share)
}

/// One channel from the sRGB curve to linear light.
pub fn to_linear(byte: u8) -> f32 {
    let x = f32::from(byte) / 255.0;
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// One channel from linear light to the sRGB curve.
pub fn to_srgb(x: f32) -> u8 {
    let x = x.clamp(0.0, 1.0);
    let y = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (y * 255.0).round() as u8
}
