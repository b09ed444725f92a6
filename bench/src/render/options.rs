//! Options of a rendered scene and their checks.

use quadlift::synthetic::SyntheticError;

use super::objects::ObjectKind;

/// Everything that can be chosen about a rendered scene.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderOptions {
    /// Seed of the random numbers: the world, the cameras, the noise of boxes and sensors.
    pub seed: u64,
    /// Number of objects, at most 255. They stand close together, so that they hide parts of each other.
    pub objects: usize,
    /// The kinds of objects, not empty: taken in turn, in an order that is drawn. By default a third are ellipsoids.
    pub kinds: Vec<ObjectKind>,
    /// Number of views.
    pub views: usize,
    /// Width of the images in pixels.
    pub width: u32,
    /// Height of the images in pixels.
    pub height: u32,
    /// Angle that the camera goes around the objects, in degrees.
    pub arc: f64,
    /// Share of the objects, in [0, 1], whose main color is drawn around that of the ground.
    pub camouflage: f64,
    /// Factor on the noise of the sensor and on the changes of exposure; 1 is a small camera in a room.
    pub sensor_noise: f64,
    /// Gaussian noise of each box edge: its standard deviation in units of the mean half size of the exact box.
    pub box_noise: f64,
    /// Objects of which a smaller share is visible, in [0, 1], are not detected.
    pub least_visible: f64,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            objects: 4,
            kinds: [ObjectKind::ALL.as_slice(), &[ObjectKind::Ellipsoid; 3]].concat(),
            views: 20,
            width: 480,
            height: 360,
            arc: 100.0,
            camouflage: 0.25,
            sensor_noise: 1.0,
            box_noise: 0.0,
            least_visible: 0.2,
        }
    }
}

impl RenderOptions {
    /// Refuses what would not give a scene.
    pub(super) fn check(&self) -> Result<(), SyntheticError> {
        let require = |holds: bool, what: &'static str, value: f64, expected: &'static str| {
            if holds { Ok(()) } else { Err(SyntheticError::OutOfRange { what, value, expected }) }
        };
        require(self.objects <= 255, "number of objects", self.objects as f64, "at most 255")?;
        require(!self.kinds.is_empty(), "number of kinds of objects", 0.0, "one or more")?;
        for (what, size) in [("width of the images", self.width), ("height of the images", self.height)] {
            require((16..=16384).contains(&size), what, f64::from(size), "a number from 16 to 16384")?;
        }
        require(self.arc.is_finite(), "angle of the arc", self.arc, "a finite number")?;
        let share = |x: f64| (0.0..=1.0).contains(&x);
        require(share(self.camouflage), "share of camouflaged objects", self.camouflage, "a number from 0 to 1")?;
        require(share(self.least_visible), "minimum visible share", self.least_visible, "a number from 0 to 1")?;
        for (what, amount) in [("sensor noise", self.sensor_noise), ("box noise", self.box_noise)] {
            require(amount.is_finite() && amount >= 0.0, what, amount, "a number that is not negative")?;
        }
        Ok(())
    }
}
