//! One image of the desk: rays from the camera, a large lamp with soft shadows, and light from everywhere that corners
//! keep out.

use image::{Rgb, RgbImage};
use nalgebra::{Matrix3, Point3, Vector3};
use quadlift::geometry::Projection;
use quadlift::synthetic::SyntheticFrame;

use super::paint::{Light, hash, srgb};
use super::things::{Form, Part};
use crate::label_image::LabelImage;

/// A ray that has just left a surface does not meet it again within this length (metres).
const NEAREST: f64 = 1e-5;
/// The lamp: a corner and two sides, metres.
const LAMP: [[f64; 3]; 3] = [[-1.15, -0.75, 1.55], [0.75, 0.1, 0.1], [-0.1, 0.8, 0.25]];
/// Points of the lamp along each side that are looked at first, and where those differ.
const FEW: u32 = 2;
const MANY: u32 = 4;
/// Distance at which the lamp is as bright as its colour says.
const LAMP_DISTANCE: f64 = 1.7;
/// Surfaces darken each other within about this distance.
const NEAR: f64 = 0.05;

/// A part, prepared for rays.
pub(super) struct Target<'a> {
    part: &'a Part,
    to_unit: Matrix3<f64>,
    radius: f64,
    number: u32,
    /// Whether it casts shadows: wall and floor have nothing behind them.
    casts: bool,
}

impl<'a> Target<'a> {
    pub(super) fn all(parts: &'a [Part]) -> Vec<Self> {
        let target = |(k, part): (usize, &'a Part)| Target {
            part,
            to_unit: part.to_unit(),
            radius: part.radius(),
            number: k as u32 + 1,
            casts: part.radius() < 2.0,
        };
        parts.iter().enumerate().map(target).collect()
    }

    /// Where a ray meets the part, as a multiple of its direction, which has length one; infinite where it does not.
    fn distance(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> f64 {
        let to = self.part.center - origin;
        let along = to.dot(direction);
        let apart = to.norm_squared() - along * along;
        if apart > self.radius * self.radius || along < -self.radius {
            return f64::INFINITY;
        }
        let (o, d) = (self.to_unit * -to, self.to_unit * direction);
        match self.part.form {
            Form::Full(shape) => shape.distance(&o, &d),
            Form::Bowl => roots(o.norm_squared(), o.dot(&d), d.norm_squared())
                .into_iter()
                .find(|t| *t > NEAREST && o.z + t * d.z <= 0.0)
                .unwrap_or(f64::INFINITY),
            Form::Cup => {
                let side = roots(o.xy().norm_squared(), o.xy().dot(&d.xy()), d.xy().norm_squared())
                    .into_iter()
                    .find(|t| *t > NEAREST && (o.z + t * d.z).abs() <= 1.0)
                    .unwrap_or(f64::INFINITY);
                // The bottom inside is a little higher than that below.
                let bottom = |z: f64| {
                    let t = (z - o.z) / d.z;
                    let inside = (o + d * t).xy().norm_squared() <= 1.0;
                    if t > NEAREST && inside { t } else { f64::INFINITY }
                };
                side.min(bottom(-0.9)).min(bottom(-1.0))
            }
        }
    }

    /// The normal at a point of the surface on the side of the camera, and the point in the frame of the part.
    fn normal(&self, point: &Point3<f64>, direction: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let unit = self.to_unit * (point - self.part.center);
        let local = match self.part.form {
            Form::Full(shape) => shape.normal(&unit),
            Form::Bowl => unit,
            Form::Cup if unit.xy().norm() < 0.995 => Vector3::z(),
            Form::Cup => Vector3::new(unit.x, unit.y, 0.0),
        };
        let normal = (self.to_unit.transpose() * local).normalize();
        (if normal.dot(direction) > 0.0 { -normal } else { normal }, unit)
    }

    /// How much the part keeps light from everywhere off a point: from the nearest point of its box.
    fn occlusion(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> f32 {
        // Squares are quick; walls and the desk are large.
        if (self.part.center - point).norm_squared() > (self.radius + 4.0 * NEAR).powi(2) {
            return 0.0;
        }
        let unit = (self.to_unit * (point - self.part.center)).map(|x| x.clamp(-0.9, 0.9));
        let nearest = self.part.center + self.part.rotation * unit.component_mul(&self.part.half);
        let to = nearest - point;
        let distance = to.norm().max(1e-4);
        let facing = (normal.dot(&to) / distance).max(0.0);
        (0.55 * facing / (1.0 + (distance / NEAR).powi(2))) as f32
    }
}

/// Where `|o + t d| = 1`, from the products `o.o`, `o.d` and `d.d`; infinite where nowhere.
fn roots(oo: f64, od: f64, dd: f64) -> [f64; 2] {
    let discriminant = od * od - dd * (oo - 1.0);
    if discriminant <= 0.0 || dd == 0.0 {
        return [f64::INFINITY; 2];
    }
    let root = discriminant.sqrt();
    [(-od - root) / dd, (-od + root) / dd]
}

/// An image, its label image (thing k has the value k + 1), and for each thing the pixels it would have if nothing
/// stood in its way.
pub(super) struct Picture {
    pub(super) image: RgbImage,
    pub(super) labels: LabelImage,
    pub(super) whole: Vec<u32>,
}

/// Renders a frame.
pub(super) fn render(targets: &[Target], frame: &SyntheticFrame, things: usize) -> Picture {
    let camera = Camera::new(frame);
    let (width, height) = (frame.width, frame.height);
    let windows: Vec<[f64; 4]> = targets.iter().map(|target| camera.window(target)).collect();
    let mut light = vec![Light::zeros(); (width * height) as usize];
    let mut seen = vec![0u32; light.len()];
    let mut values = vec![0u16; light.len()];
    let mut whole = vec![0u32; things];
    let mut met = vec![u32::MAX; things];
    for y in 0..height {
        let row: Vec<usize> = (0..targets.len())
            .filter(|&k| f64::from(y) + 1.0 >= windows[k][1] && f64::from(y) <= windows[k][3])
            .collect();
        for x in 0..width {
            let pixel = y * width + x;
            let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let near = |k: &usize| f64::from(x) + 1.0 >= windows[*k][0] && f64::from(x) <= windows[*k][2];
            let (mut first, mut length) = (None, f64::INFINITY);
            for k in row.iter().copied().filter(near) {
                let t = targets[k].distance(&camera.center, &direction);
                if t.is_infinite() {
                    continue;
                }
                if let Some(thing) = targets[k].part.thing
                    && std::mem::replace(&mut met[thing], pixel) != pixel
                {
                    whole[thing] += 1;
                }
                if t < length {
                    (first, length) = (Some(k), t);
                }
            }
            let at = pixel as usize;
            light[at] = shade(targets, &camera.center, &direction, first.map(|k| (k, length)), pixel);
            seen[at] = first.map_or(0, |k| targets[k].number);
            values[at] = first.and_then(|k| targets[k].part.thing).map_or(0, |thing| thing as u16 + 1);
        }
    }
    for y in 0..height {
        for x in 0..width {
            let at = |x: u32, y: u32| (y * width + x) as usize;
            let neighbours = [
                (x.saturating_sub(1), y),
                ((x + 1).min(width - 1), y),
                (x, y.saturating_sub(1)),
                (x, (y + 1).min(height - 1)),
            ];
            if neighbours.iter().all(|&(nx, ny)| seen[at(nx, ny)] == seen[at(x, y)]) {
                continue;
            }
            let quarters = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
            let sum: Light = quarters
                .iter()
                .map(|(dx, dy)| {
                    let direction = camera.direction(f64::from(x) + dx, f64::from(y) + dy);
                    tone(&shade(
                        targets,
                        &camera.center,
                        &direction,
                        trace(targets, &camera.center, &direction),
                        at(x, y) as u32,
                    ))
                })
                .sum();
            // Marked as finished: tones are never negative.
            light[at(x, y)] = -(sum * 0.25).add_scalar(1e-6);
        }
    }
    let image = RgbImage::from_fn(width, height, |x, y| {
        let at = (y * width + x) as usize;
        let value = if light[at].x < 0.0 { -light[at] } else { tone(&light[at]) };
        // The grain of a sensor.
        let grain = 0.012 * (hash(at as i32, frame.id.len() as i32, 11) + hash(at as i32, 7, 13) - 1.0);
        Rgb([0, 1, 2].map(|c| ((value[c] + grain) * 255.0 + 0.5) as u8))
    });
    // One value for each pixel: the size cannot be wrong.
    Picture { image, labels: LabelImage::new(width, height, values).unwrap_or_default(), whole }
}

/// What a ray meets first: index of the target, and length.
fn trace(targets: &[Target], origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<(usize, f64)> {
    let hits = targets.iter().enumerate().map(|(k, target)| (k, target.distance(origin, direction)));
    hits.filter(|(_, t)| t.is_finite()).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The light that comes back along a ray.
fn shade(
    targets: &[Target],
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
    hit: Option<(usize, f64)>,
    pixel: u32,
) -> Light {
    let Some((index, length)) = hit else { return srgb(188, 192, 196) };
    let target = &targets[index];
    let point = origin + direction * length;
    let (normal, unit) = target.normal(&point, direction);
    let place = unit.component_mul(&target.part.half);
    let color = target.part.paint.color(&unit, &place);
    let (gloss, own) = target.part.paint.gloss(&unit);
    let start = point + normal * 1e-4;
    let open: f32 = targets
        .iter()
        .filter(|other| other.number != target.number)
        .map(|other| 1.0 - other.occlusion(&point, &normal))
        .product();
    let above = normal.z as f32;
    let sky = (srgb(172, 186, 205) * (0.62 + 0.3 * above) + srgb(200, 160, 120) * (0.16 - 0.12 * above)) * open;
    let (lamp, shine) = lamp_light(targets, &start, &normal, direction, gloss, pixel);
    let lit = sky * 0.72 + Light::new(1.0, 0.93, 0.82) * (1.25 * lamp);
    color.component_mul(&lit) * (1.0 - own) + color * own + Light::repeat(shine)
}

/// The light of the lamp on a surface, and its highlight.
fn lamp_light(
    targets: &[Target],
    point: &Point3<f64>,
    normal: &Vector3<f64>,
    view: &Vector3<f64>,
    gloss: f32,
    pixel: u32,
) -> (f32, f32) {
    let [corner, side, other] = LAMP.map(Vector3::from);
    let middle = Point3::from(corner + 0.5 * (side + other));
    let to = middle - point;
    let facing = normal.dot(&to.normalize());
    if facing <= 0.0 {
        return (0.0, 0.0);
    }
    // What may stand between: whatever comes near the cone from the point to the lamp.
    let axis = to.normalize();
    let (length, spread) = (to.norm(), 0.5 * (side.norm() + other.norm()) / to.norm());
    let between = |target: &&Target| {
        let away = target.part.center - point;
        let along = away.dot(&axis);
        let apart = away.norm_squared() - along * along;
        along > -target.radius && along < length && apart < (target.radius + spread * along.max(0.0)).powi(2)
    };
    let blockers: Vec<&Target> = targets.iter().filter(|target| target.casts).filter(between).collect();
    let visible = |n: u32| -> u32 {
        let mut count = 0;
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            // A little to and fro, the same for every run.
            let jitter = |salt: i32| 0.2 + 0.6 * f64::from(hash(pixel as i32, (i * n + j) as i32 + salt, n as i32));
            let (s, t) = ((f64::from(i) + jitter(0)) / f64::from(n), (f64::from(j) + jitter(31)) / f64::from(n));
            let place = Point3::from(corner + side * s + other * t);
            let ray = place - point;
            let length = ray.norm();
            let direction = ray / length;
            if !blockers.iter().any(|target| target.distance(point, &direction) < length) {
                count += 1;
            }
        }
        count
    };
    let few = if blockers.is_empty() { FEW * FEW } else { visible(FEW) };
    let share = match few {
        0 => 0.0,
        n if n == FEW * FEW => 1.0,
        _ => f64::from(visible(MANY)) / f64::from(MANY * MANY),
    };
    let falloff = (LAMP_DISTANCE / to.norm()).powi(2).min(2.0);
    let half = (to.normalize() - view).normalize();
    let shine = f64::from(gloss) * normal.dot(&half).max(0.0).powi(60) * share;
    ((facing * share * falloff) as f32, shine as f32)
}

/// From light to the tone of a photograph, in [0, 1].
fn tone(light: &Light) -> Light {
    // Bright parts are pressed together instead of cut off.
    light.map(|x| {
        let x = (x * 1.12).max(0.0);
        let pressed = x * (1.0 + x / 4.0) / (1.0 + x);
        (1.18 * pressed).min(1.0).powf(1.0 / 2.2)
    })
}

/// A pinhole camera.
struct Camera {
    center: Point3<f64>,
    /// World from camera.
    rotation: Matrix3<f64>,
    focal: f64,
    middle: [f64; 2],
    projection: Projection,
    size: [f64; 2],
}

impl Camera {
    fn new(frame: &SyntheticFrame) -> Self {
        let pose = frame.cam_from_world.matrix();
        let rotation: Matrix3<f64> = pose.fixed_columns::<3>(0).transpose();
        let center = Point3::from(-(rotation * pose.column(3)));
        Self {
            center,
            rotation,
            focal: frame.intrinsics.fx,
            middle: [frame.intrinsics.cx, frame.intrinsics.cy],
            projection: Projection::from_camera(&frame.intrinsics, &frame.cam_from_world),
            size: [f64::from(frame.width), f64::from(frame.height)],
        }
    }

    /// The direction of the ray through a place of the image, with length one.
    fn direction(&self, x: f64, y: f64) -> Vector3<f64> {
        let [cx, cy] = self.middle;
        (self.rotation * Vector3::new((x - cx) / self.focal, (y - cy) / self.focal, 1.0)).normalize()
    }

    /// Where a part may be seen: x0, y0, x1, y1.
    fn window(&self, target: &Target) -> [f64; 4] {
        let whole = [0.0, 0.0, self.size[0], self.size[1]];
        let part = target.part;
        let depth = |p: &Point3<f64>| (self.rotation.transpose() * (p - self.center)).z;
        // The corners of its box hold it wherever it is convex or hollow.
        let corners = (0..8).map(|k| {
            let unit = Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -1.0 } else { 1.0 });
            part.center + part.rotation * unit.component_mul(&part.half)
        });
        let mut window = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
        for corner in corners {
            if depth(&corner) < 0.05 {
                return whole;
            }
            let Some(pixel) = self.projection.project_point(&corner) else { return whole };
            window = [window[0].min(pixel.x), window[1].min(pixel.y), window[2].max(pixel.x), window[3].max(pixel.y)];
        }
        window
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::desk::paint::Paint;
    use crate::render::solid::Shape;
    use nalgebra::Rotation3;

    fn part(form: Form) -> Part {
        let half = Vector3::new(0.1, 0.1, 0.05);
        let paint = Paint::Plain(Light::repeat(0.5));
        Part { form, center: Point3::origin(), rotation: Rotation3::identity(), half, paint, thing: None }
    }

    #[test]
    fn rays_go_into_what_is_open_above() {
        for (form, depth) in [(Form::Bowl, 0.05), (Form::Cup, 0.045)] {
            let parts = [part(form)];
            let target = &Target::all(&parts)[0];
            let from_above = target.distance(&Point3::new(0.0, 0.0, 1.0), &-Vector3::z());
            assert!((from_above - (1.0 + depth)).abs() < 1e-9, "{form:?} {from_above}");
            let from_aside = target.distance(&Point3::new(1.0, 0.0, -0.001), &-Vector3::x());
            assert!((from_aside - 0.9).abs() < 1e-3, "{form:?} {from_aside}");
            // From above into the far wall: the near one lies behind the ray's start.
            let direction = Vector3::new(1.0, 0.0, -1.0).normalize();
            let inside = target.distance(&Point3::new(0.0, 0.0, 0.06), &direction);
            let (normal, _) = target.normal(&(Point3::new(0.0, 0.0, 0.06) + direction * inside), &direction);
            assert!(inside < 0.3 && normal.dot(&direction) < 0.0, "{form:?}");
        }
        assert!(matches!(Form::Full(Shape::Cuboid), Form::Full(_)));
    }
}
