//! What surfaces look like: wood, covers of books, labels of cans, keys, a picture on a screen. All of it is computed.

use nalgebra::Vector3;

/// Linear light: red, green, blue.
pub(super) type Light = Vector3<f32>;

/// A surface.
#[derive(Debug, Clone, Copy)]
pub(super) enum Paint {
    /// One colour with a little variation.
    Plain(Light),
    /// Boards along the first axis.
    Wood(Light),
    /// A book: its cover, and the title; the sides are pages.
    Cover(Light, Light),
    /// A can: its label, and the band and the mark on it; ends of metal.
    Can(Light, Light),
    /// A carton: its colour, and what is printed on it.
    Carton(Light, Light),
    /// A keyboard.
    Keys,
    /// A monitor: a landscape on the front, a dark case.
    Screen,
    /// A ball with a curved seam.
    Tennis(Light),
    /// A picture in a frame.
    Poster,
}

/// A colour from the numbers people know (sRGB from 0 to 255), as linear light.
pub(super) fn srgb(red: u8, green: u8, blue: u8) -> Light {
    Light::new(f32::from(red), f32::from(green), f32::from(blue)).map(|x| (x / 255.0).powf(2.2))
}

impl Paint {
    /// The colour at a point of the surface: `unit` in the frame in which the half sizes are 1, `place` in metres.
    pub(super) fn color(&self, unit: &Vector3<f64>, place: &Vector3<f64>) -> Light {
        let p = place.map(|x| x as f32);
        let u = unit.map(|x| x as f32);
        match *self {
            Self::Plain(color) => color * (0.94 + 0.12 * noise(&(p * 60.0))),
            Self::Wood(color) => {
                let board = (p.y / 0.14).floor();
                let along = Vector3::new(p.x * 2.2 + 7.3 * board, p.y * 26.0, p.z * 20.0 + board);
                let grain = 0.5 + 0.5 * (noise(&along) * 9.0 + p.y * 90.0).sin();
                let seam = if (p.y / 0.14 - board).min(1.0 - (p.y / 0.14 - board)) < 0.012 { 0.55 } else { 1.0 };
                let tone = 0.84 + 0.1 * hash(board as i32, 3, 5) + 0.16 * noise(&(along * 0.5));
                color * (tone - 0.13 * grain) * seam
            }
            Self::Cover(cover, title) => {
                // The cover lies across the third axis, the spine is at the first axis' lower end.
                let on_cover = u.z.abs() > 0.985;
                if !on_cover && u.x > -0.97 {
                    let lines = 0.5 + 0.5 * (p.z * 2400.0).sin();
                    return srgb(238, 232, 214) * (0.82 + 0.18 * lines);
                }
                if !on_cover {
                    let band = (0.35..0.6).contains(&u.y.abs());
                    return if band { title } else { cover } * 0.9;
                }
                let frame = u.x.abs().max(u.y.abs());
                let words = (u.y - 0.45).abs() < 0.09 && u.x.abs() < 0.62;
                let name = (u.y + 0.6).abs() < 0.04 && u.x.abs() < 0.35;
                let sun = (u.x * 0.9).hypot(u.y + 0.1) < 0.27;
                let printed = words || name || sun || (0.86..0.9).contains(&frame);
                if printed { title } else { cover * (0.94 + 0.1 * noise(&(p * 90.0))) }
            }
            Self::Can(label, mark) => {
                if u.z.abs() > 0.86 {
                    let ring = 0.5 + 0.5 * (u.xy().norm() * 26.0).sin();
                    return srgb(196, 200, 205) * (0.75 + 0.25 * ring);
                }
                let angle = u.y.atan2(u.x);
                let wave = u.z + 0.18 * (2.0 * angle).sin();
                let turn = ((angle * 1.5).sin().abs() * 1.2).hypot(u.z * 1.6 - 0.1);
                if turn < 0.52 || (wave + 0.58).abs() < 0.08 { mark } else { label }
            }
            Self::Carton(color, print) => {
                let edge = [u.x.abs(), u.y.abs(), u.z.abs()].into_iter().filter(|x| *x < 0.985).fold(0.0, f32::max);
                let (a, b) = if u.x.abs() > 0.985 {
                    (u.y, u.z)
                } else if u.y.abs() > 0.985 {
                    (u.x, u.z)
                } else {
                    (u.x, u.y)
                };
                let disc = (a * 0.9).hypot(b - 0.15) < 0.42;
                let bars = b < -0.5 && (b * 14.0).sin() > 0.1 && a.abs() < 0.7;
                let paper = srgb(245, 240, 230);
                match () {
                    () if edge > 0.965 => color * 0.7,
                    () if disc => print,
                    () if bars => paper,
                    () => color * (0.95 + 0.08 * noise(&(p * 70.0))),
                }
            }
            Self::Keys => {
                if u.z < 0.9 {
                    return srgb(52, 54, 58);
                }
                let (row, column) = ((u.y + 1.0) * 2.5, (u.x + 1.0) * 8.5 + 0.35 * ((u.y + 1.0) * 2.5).floor());
                let (fr, fc) = (row - row.floor(), column - column.floor());
                let gap = fr.min(1.0 - fr) < 0.1 || fc.min(1.0 - fc) < 0.09;
                let sign = (fr - 0.6).abs() < 0.12 && (fc - 0.4).abs() < 0.1;
                if u.x.abs() > 0.97 || u.y.abs() > 0.94 || gap {
                    srgb(46, 48, 52)
                } else if sign {
                    srgb(60, 62, 66)
                } else {
                    srgb(214, 216, 218)
                }
            }
            Self::Screen => {
                if u.y > -0.9 || u.x.abs() > 0.96 || u.z.abs() > 0.93 {
                    return srgb(34, 35, 38);
                }
                landscape(u.x / 0.96, u.z / 0.93)
            }
            Self::Tennis(color) => {
                let seam = (u.z - 0.55 * (2.0 * u.y.atan2(u.x)).sin() * u.xy().norm()).abs() < 0.07;
                if seam { srgb(240, 240, 235) } else { color * (0.85 + 0.3 * noise(&(p * 400.0))) }
            }
            Self::Poster => {
                if u.x.abs() > 0.9 || u.z.abs() > 0.92 {
                    return srgb(60, 44, 30);
                }
                if u.x.abs() > 0.72 || u.z.abs() > 0.78 {
                    return srgb(242, 238, 228);
                }
                landscape(u.x, u.z) * 0.8 + Light::new(0.06, 0.04, 0.02)
            }
        }
    }

    /// Strength of the highlight, and the light that the surface gives itself (a screen's), as a share of its colour.
    pub(super) fn gloss(&self, unit: &Vector3<f64>) -> (f32, f32) {
        match self {
            Self::Can(..) => (0.5, 0.0),
            Self::Screen if unit.y < -0.9 => (0.05, 0.85),
            Self::Screen | Self::Keys => (0.12, 0.0),
            Self::Cover(..) | Self::Carton(..) => (0.1, 0.0),
            Self::Plain(_) => (0.3, 0.0),
            Self::Wood(_) => (0.08, 0.0),
            Self::Tennis(_) | Self::Poster => (0.02, 0.0),
        }
    }
}

/// Hills under an evening sky, for x and y in [-1, 1].
fn landscape(x: f32, y: f32) -> Light {
    let hill = |height: f32, rough: f32, seed: f32| {
        height
            + 0.3 * rough * (3.1 * x + seed).sin()
            + 0.25 * (noise(&Vector3::new(2.5 * x * rough + seed, seed, 0.0)) - 0.5)
    };
    if y < hill(-0.55, 0.5, 1.0) {
        srgb(24, 62, 58)
    } else if y < hill(-0.25, 0.8, 4.0) {
        srgb(44, 98, 92)
    } else if y < hill(0.0, 1.2, 8.0) {
        srgb(88, 132, 150)
    } else if (x - 0.35).hypot(0.8 * (y - 0.32)) < 0.15 {
        srgb(255, 236, 170)
    } else {
        let t = ((y + 0.1) / 1.1).clamp(0.0, 1.0);
        srgb(250, 178, 110) * (1.0 - t) + srgb(74, 110, 190) * t
    }
}

/// A number from 0 to 1 for each point of a lattice.
pub(super) fn hash(x: i32, y: i32, z: i32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x8da6_b343)
        ^ (y as u32).wrapping_mul(0xd816_3841)
        ^ (z as u32).wrapping_mul(0xcb1a_b31f);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    ((h ^ (h >> 15)) >> 8) as f32 / (1u32 << 24) as f32
}

/// Smooth noise from 0 to 1: the lattice's numbers, mixed.
fn noise(p: &Vector3<f32>) -> f32 {
    let cell = p.map(f32::floor);
    let t = (p - cell).map(|x| x * x * (3.0 - 2.0 * x));
    let at = |dx: i32, dy: i32, dz: i32| hash(cell.x as i32 + dx, cell.y as i32 + dy, cell.z as i32 + dz);
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let plane = |dz: i32| mix(mix(at(0, 0, dz), at(1, 0, dz), t.x), mix(at(0, 1, dz), at(1, 1, dz), t.x), t.y);
    mix(plane(0), plane(1), t.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_between_0_and_1_and_varies() {
        let values: Vec<f32> = (0..500).map(|k| noise(&Vector3::new(k as f32 * 0.37, k as f32 * -0.21, 0.5))).collect();
        assert!(values.iter().all(|x| (0.0..=1.0).contains(x)));
        let mean = values.iter().sum::<f32>() / 500.0;
        let spread = values.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / 500.0;
        assert!((mean - 0.5).abs() < 0.1 && spread > 0.01, "{mean} {spread}");
    }
}
