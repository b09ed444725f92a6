//! One image: a ray through the center of every pixel, and four more where something begins or ends.

use nalgebra::{Matrix3, Point3, Vector3};
use quadlift::geometry::{Projection, ProjectionError};
use quadlift::synthetic::SyntheticFrame;
use quadlift_segment::LabelImage;
use quadlift_segment::image::RgbImage;
use rand_chacha::ChaCha8Rng;

use super::options::RenderOptions;
use super::sensor;
use super::solid::Solid;
use super::texture::Color;
use super::world::World;

/// The ground is seen up to this distance; beyond is the sky.
const HORIZON: f64 = 60.0;

/// Brightness in full light, of which [`World::ambient`] is a part.
const FULL_LIGHT: f32 = 1.1;

/// Exponent of the highlights.
const GLOSS: i32 = 40;

/// A frame as it comes out.
pub(super) struct Rendering {
    pub(super) image: RgbImage,
    /// Object k has the value k + 1.
    pub(super) labels: LabelImage,
    /// For each object, its pixels in the image if nothing else stood in the way.
    pub(super) whole: Vec<u32>,
}

/// Renders one frame; `rng` serves the sensor.
pub(super) fn render(
    world: &World,
    frame: &SyntheticFrame,
    options: &RenderOptions,
    rng: &mut ChaCha8Rng,
) -> Rendering {
    let view = View::new(world, frame);
    let (width, height) = (frame.width as usize, frame.height as usize);
    let mut colors = Vec::with_capacity(width * height);
    let mut seen = Vec::with_capacity(width * height);
    let mut labels = Vec::with_capacity(width * height);
    let mut whole = vec![0; world.objects.len()];
    // For each object the last pixel in which it was met, so that each is counted once for a pixel.
    let mut met = vec![u32::MAX; world.objects.len()];
    for y in 0..frame.height {
        let row: Vec<&Target> = view.targets.iter().filter(|t| t.window[1] <= y && y < t.window[3]).collect();
        for x in 0..frame.width {
            let pixel = y * frame.width + x;
            let near = row.iter().copied().filter(|t| t.window[0] <= x && x < t.window[2]);
            let hit = view.trace(f64::from(x) + 0.5, f64::from(y) + 0.5, near, |object| {
                if std::mem::replace(&mut met[object], pixel) != pixel {
                    whole[object] += 1;
                }
            });
            colors.push(view.color(&hit));
            labels.push(match hit.surface {
                Surface::Solid(target) => target.object.map_or(0, |object| object as u16 + 1),
                Surface::Ground | Surface::Sky => 0,
            });
            seen.push(hit.surface.number());
        }
    }
    for (x, y) in border_pixels(&seen, frame.width, frame.height) {
        // A neighbor may begin within this pixel, beyond its own window of whole pixels.
        let near = || {
            let reaches = |t: &&Target| {
                let [x0, y0, x1, y1] = t.window;
                x0 <= x + 1 && x < x1 + 1 && y0 <= y + 1 && y < y1 + 1
            };
            view.targets.iter().filter(reaches)
        };
        let quarters = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
        let color: Color = quarters
            .into_iter()
            .map(|(dx, dy)| view.color(&view.trace(f64::from(x) + dx, f64::from(y) + dy, near(), |_| {})))
            .sum();
        colors[(y * frame.width + x) as usize] = color * 0.25;
    }
    Rendering {
        image: sensor::expose(colors, frame.width, frame.height, options.sensor_noise, rng),
        // One value for each pixel: the size cannot be wrong.
        labels: LabelImage::new(frame.width, frame.height, labels).unwrap_or_default(),
        whole,
    }
}

/// The pixels next to one in which something else is seen.
fn border_pixels(seen: &[u32], width: u32, height: u32) -> Vec<(u32, u32)> {
    let at = |x: u32, y: u32| seen[(y * width + x) as usize];
    let differs = |x: u32, y: u32| {
        let own = at(x, y);
        (x > 0 && at(x - 1, y) != own)
            || (x + 1 < width && at(x + 1, y) != own)
            || (y > 0 && at(x, y - 1) != own)
            || (y + 1 < height && at(x, y + 1) != own)
    };
    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(|&(x, y)| differs(x, y)).collect()
}

/// A solid, prepared for the rays of one camera and for the light.
struct Target<'a> {
    solid: &'a Solid,
    number: u32,
    object: Option<usize>,
    to_unit: Matrix3<f64>,
    /// The camera in the frame of the shape.
    camera: Vector3<f64>,
    /// The direction of the light in the frame of the shape.
    light: Vector3<f64>,
    /// Where the solid may be seen: columns and rows `[x0, y0, x1, y1]`, end not included.
    window: [u32; 4],
    /// The center along two directions across the light and along it, and the radius: for a quick test of shadows.
    across: [f64; 3],
    radius: f64,
}

impl Target<'_> {
    /// Whether the ray from a point outside towards the light meets the solid.
    fn meets_light(&self, point: &Point3<f64>) -> bool {
        self.solid.shape.distance(&(self.to_unit * (point - self.solid.center)), &self.light).is_finite()
    }
}

/// What a ray meets.
#[derive(Clone, Copy)]
enum Surface<'a> {
    Sky,
    Ground,
    Solid(&'a Target<'a>),
}

impl Surface<'_> {
    fn number(&self) -> u32 {
        match self {
            Self::Sky => 0,
            Self::Ground => 1,
            Self::Solid(target) => target.number,
        }
    }
}

/// Where a ray ends.
struct Hit<'a> {
    surface: Surface<'a>,
    /// Unit direction of the ray.
    direction: Vector3<f64>,
    /// Length of the ray.
    length: f64,
}

/// The world, prepared for one camera.
struct View<'a> {
    world: &'a World,
    camera: Point3<f64>,
    /// From homogeneous pixels to directions of the world.
    rays: Matrix3<f64>,
    /// The solids in the image, and the others, which only throw shadows.
    targets: Vec<Target<'a>>,
    hidden: Vec<Target<'a>>,
    /// Two directions across the light, and the light.
    across: [Vector3<f64>; 3],
}

impl<'a> View<'a> {
    fn new(world: &'a World, frame: &SyntheticFrame) -> Self {
        let projection = Projection::from_camera(&frame.intrinsics, &frame.cam_from_world);
        let pose = frame.cam_from_world.matrix();
        let from_camera = pose.fixed_columns::<3>(0).transpose();
        let camera = Point3::from(-(from_camera * pose.column(3)));
        let k = &frame.intrinsics;
        let from_pixel = Matrix3::new(1.0 / k.fx, 0.0, -k.cx / k.fx, 0.0, 1.0 / k.fy, -k.cy / k.fy, 0.0, 0.0, 1.0);
        let first = world.light.cross(&Vector3::x()).normalize();
        let across = [first, world.light.cross(&first), world.light];
        let (mut targets, mut hidden) = (Vec::new(), Vec::new());
        for (number, (object, solid)) in (2..).zip(world.solids()) {
            let to_unit = solid.to_unit();
            let window = window(solid, &projection, frame);
            let target = Target {
                solid,
                number,
                object,
                to_unit,
                camera: to_unit * (camera - solid.center),
                light: to_unit * world.light,
                window: window.unwrap_or_default(),
                across: across.map(|direction| direction.dot(&solid.center.coords)),
                radius: solid.radius(),
            };
            if window.is_some() { targets.push(target) } else { hidden.push(target) }
        }
        Self { world, camera, rays: from_camera * from_pixel, targets, hidden, across }
    }

    /// What the ray through a point of the image meets first; `meets` is called for every object that it meets.
    fn trace<'b>(
        &'b self,
        x: f64,
        y: f64,
        near: impl Iterator<Item = &'b Target<'b>>,
        mut meets: impl FnMut(usize),
    ) -> Hit<'b> {
        let direction = (self.rays * Vector3::new(x, y, 1.0)).normalize();
        let (mut surface, mut length) = (Surface::Sky, f64::INFINITY);
        for target in near {
            let t = target.solid.shape.distance(&target.camera, &(target.to_unit * direction));
            if t < f64::INFINITY {
                if let Some(object) = target.object {
                    meets(object);
                }
                if t < length {
                    (surface, length) = (Surface::Solid(target), t);
                }
            }
        }
        let to_ground = -self.camera.z / direction.z;
        if direction.z < 0.0 && to_ground < length.min(HORIZON) {
            (surface, length) = (Surface::Ground, to_ground);
        }
        Hit { surface, direction, length }
    }

    /// The light that comes along a ray.
    fn color(&self, hit: &Hit) -> Color {
        let point = self.camera + hit.direction * hit.length;
        let (color, normal, shine) = match hit.surface {
            Surface::Sky => return self.world.sky.color(&hit.direction.map(|x| x as f32)),
            Surface::Ground => (self.world.ground.color(&point.coords.map(|x| x as f32)), Vector3::z(), 0.0),
            Surface::Solid(target) => {
                let unit = target.to_unit * (point - target.solid.center);
                let normal = (target.to_unit.transpose() * target.solid.shape.normal(&unit)).normalize();
                (target.solid.color(&point), normal, target.solid.shine)
            }
        };
        let ambient = self.world.ambient;
        let facing = normal.dot(&self.world.light);
        if facing <= 0.0 || self.in_shadow(&(point + normal * 1e-3)) {
            return color * ambient;
        }
        let between = (self.world.light - hit.direction).normalize();
        let highlight = shine * (normal.dot(&between).max(0.0) as f32).powi(GLOSS);
        (color * (ambient + (FULL_LIGHT - ambient) * facing as f32)).add_scalar(highlight)
    }

    /// Whether something stands between a point and the light.
    fn in_shadow(&self, point: &Point3<f64>) -> bool {
        let [u, v, along] = self.across.map(|direction| direction.dot(&point.coords));
        self.targets.iter().chain(&self.hidden).any(|target| {
            let (du, dv) = (target.across[0] - u, target.across[1] - v);
            du * du + dv * dv < target.radius * target.radius
                && target.across[2] + target.radius > along
                && target.meets_light(point)
        })
    }
}

/// The columns and rows in whose pixels the solid may be seen; `None` when it is not in the image.
fn window(solid: &Solid, projection: &Projection, frame: &SyntheticFrame) -> Option<[u32; 4]> {
    match solid.bounds(projection) {
        Ok(bounds) => {
            let clip = |x: f64, size: u32| x.clamp(0.0, f64::from(size)) as u32;
            let [x0, y0] = [clip(bounds.x0().floor(), frame.width), clip(bounds.y0().floor(), frame.height)];
            let [x1, y1] = [clip(bounds.x1().ceil(), frame.width), clip(bounds.y1().ceil(), frame.height)];
            (x0 < x1 && y0 < y1).then_some([x0, y0, x1, y1])
        }
        Err(ProjectionError::StraddlesCameraPlane) => Some([0, 0, frame.width, frame.height]),
        Err(_) => None,
    }
}
