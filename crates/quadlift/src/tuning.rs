//! Constants that were tuned, with the data, the sweep and how flat the optimum is (docs/method/constants.csv lists all
//! constants). With the feature `sensitivity` a program can scale them: `quadlift-bench sensitivity`.

#[cfg(feature = "sensitivity")]
use std::sync::atomic::{AtomicU64, Ordering};

/// Log odds that are clear wherever answers are compared: 100 to 1 (ours).
pub const CLEAR: f64 = 4.605;

/// A tuned constant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tuned {
    value: f64,
    #[cfg(feature = "sensitivity")]
    index: usize,
}

impl Tuned {
    /// Its value.
    #[inline(always)]
    pub(crate) fn get(self) -> f64 {
        #[cfg(feature = "sensitivity")]
        return self.value * f64::from_bits(FACTORS[self.index].load(Ordering::Relaxed));
        #[cfg(not(feature = "sensitivity"))]
        self.value
    }
}

macro_rules! tuned {
    ($($(#[$meta:meta])* $name:ident = $value:expr;)*) => {
        #[cfg(feature = "sensitivity")]
        #[allow(non_camel_case_types, clippy::upper_case_acronyms)]
        enum Index { $($name,)* }

        $($(#[$meta])*
        pub(crate) const $name: Tuned = Tuned {
            value: $value,
            #[cfg(feature = "sensitivity")]
            index: Index::$name as usize,
        };)*

        /// Names and values of the tuned constants.
        #[cfg(feature = "sensitivity")]
        pub const CONSTANTS: &[(&str, f64)] = &[$((stringify!($name), $value),)*];
    };
}

tuned! {
    // Edges that another box hides.
    /// An edge counts as inside another box up to this many pixels beyond it.
    OCCLUDER_MARGIN_PX = 5.0;
    /// Share of the hidden box's height over which the two must overlap.
    MIN_OCCLUDER_OVERLAP = 0.3;

    // The objective, outliers.
    /// Degrees of freedom of Student's t distribution, the likelihood of an edge: near zero it is a Gaussian, beyond three
    /// standard deviations it gives way.
    STUDENT_T_DOF = 9.0;

    // Noise levels.
    /// Smallest standard deviation: larger ones cost accuracy on exact data, smaller ones stability.
    NOISE_FLOOR = 2e-4;
    /// Share of the degrees of freedom that counts against what is usual. A body that is not quite of the right kind follows the
    /// measurements, and they look better than they are: many residuals do not make a level as certain as their number says
    /// (a tempered likelihood, as Gruenwald and van Ommen 2017 use it for wrong models).
    ///
    /// Tuned together with `ANY_LEVEL` (`noise_prior`) on TUW, KITTI (RRC boxes with the car prior, mean O3D; exact boxes in three views) and
    /// synthetic boxes in 2 to 20 views. From .015 to .05, with it from .1 to .5: TUW .820 to .822, KITTI .60 to .64
    /// with aligned poses and .46 to .51 with GPS poses (single cars that turn over make most of the difference); synthetic
    /// scenes of 50 objects differ by less than .005.
    TEMPERING = 0.015;
    /// So many views of an object count twice: a body cannot follow many views as it follows a few. Tuned on scenes of one
    /// synthetic object with 5 % noise, where 10 views gave O3D .756 without it and .807 with it (.815 with the level given).
    MANY_VIEWS = 8.0;
    /// Correlation between neighboring views from which many views count no more than few: there the body is wrong in a way
    /// that they share. Tuned on KITTI, whose correlations are .1 (S05) and .35 to .9 (the others).
    CORRELATED_FROM = 0.3;
    /// How much noisier occluded edges usually are, and the degrees of freedom for which that counts.
    OCCLUDED_RATIO = 2.0;
    /// How probable any other level is, relative to the usual one (per logarithm): detectors do not differ much, but boxes may
    /// come from elsewhere. See `TEMPERING` (`noise`).
    ANY_LEVEL = 0.3;
    /// Standard deviation of the logarithm of the levels of detectors. Tuned on KITTI, with `TEMPERING` (`noise`) .05:
    /// with .5, .7 and 1 O3D is .62, .62 and .59 with aligned poses and .48, .46 and .46 with GPS poses.
    USUAL_SPREAD = 0.7;

    // Covariances, alternatives.
    /// Scale of the field's correlation, as a distance between unit vectors. Tuned on LINEMOD, LMO, TUW and KITTI by the
    /// share of true centers inside the 95 % region (all sets together 83, 89, 89, 89 and 89 % at 0.1, 0.2, 0.3, 0.4 and 0.6)
    /// and the median NEES (10.7, 8.4, 7.3, 6.6 and 5.6; 8.34 is honest).
    CORRELATION_SCALE = 0.25;
    /// Log odds below which another answer is not reported: 1 to 20, which is clear. Of 400 synthetic cuboids in 8 views (boxes with 2
    /// and 5 % noise) 42 have an IoU below 0.6; 38 of them have an alternative, and 171 of the others. With -2 it is 37 and 131.
    MIN_LOG_ODDS = -3.0;

    // Upright objects, the ground plane.
    /// Share of the objects that stand before anything is known; where objects do not depend on each other, for good.
    ///
    /// Tuned with `quadlift-bench kinds` and random bodies in 3 to 20 views: an object that stands and is seen well has odds of 30 to
    /// 130 to 1, so that any share above 0.05 lets it; 0.2 keeps random bodies in three views from being set upright.
    UPRIGHT_SHARE = 0.2;
    /// Subtracted from the log odds that an ellipsoid stands. Bodies are rounder than the shape prior allows for, and a round
    /// one seems to stand: of random ellipsoids in three views of an orbit the log odds are 0.8 on average without it, of
    /// standing ones in six views 1.8 and in many views 3.5 (synthetic scenes, seeds 11 and 12).
    ROUND_BODIES = 1.0;
    // Cues.
    /// Standard deviation of the logarithm of the scale of a source of depths or distances, before anything is known: networks
    /// that estimate metric depth err by 5 to 15 % on scenes unlike their training data.
    DEPTH_SCALE_SD = 0.1;
    /// The same of 1 + shift / D, the shift of a source of depths in lengths of the world and D the median of its depths: 1 in 20.
    /// With .01, .03, .05, .07 and .1 O3D on KITTI with a shift of 1 m is .629, .644, .650, .657 and .658 (with 3D boxes .679, .683, .684,
    /// .685, .685), without a shift .658, .665, .664, .665, .663 (.689, .688, .688, .687, .687).
    DEPTH_SHIFT_SD = 0.05;
    /// The same of the scale of a frame, of networks that estimate depth up to a scale in each image.
    FRAME_SCALE_SD = 0.3;
    /// The same of the bias that a source's sizes share: 3D detectors learn the mean size of a category elsewhere, and the edges of boxes
    /// and bodies of different kinds differ by up to 1.4.
    SIZE_BIAS_SD = 0.2;
    /// The same of each extent beside what all share. With .05 and .2 O3D differs by less than .002 (3D boxes in one view, KITTI).
    EXTENT_BIAS_SD = 0.1;
    // Sizes learned from the scene.
    /// Standard deviation of the logarithm of an extent among the things of one category: the median of `size_sd / size` over the
    /// built-in priors is .158.
    CATEGORY_SPREAD = 0.16;
    /// Objects for which that counts, and the least degrees of freedom of a learned size.
    LEARNT_DOF = 4.0;
    /// Standard deviation of the plane's slopes before anything is known.
    SLOPE_SD = 0.06;
    /// Standard deviation of the height of one camera above the ground, relative to that height.
    CAMERA_HEIGHT_SD = 0.03;
    /// Standard deviation of an object's lowest point above the plane: this share of a typical object height ...
    UNEVENNESS = 0.07;
    /// ... and this share of its distance from the nearest camera.
    UNEVENNESS_FAR = 0.01;

    // Association.
    /// Share of detections with another category than that of their object.
    WRONG_CATEGORY_SHARE = 0.03;
    /// Share of the evidence that has to be left with twice the slack.
    ///
    /// The evidence itself always prefers little slack, also where poses drift and a thing becomes several objects that each
    /// agree; but where there are enough views more slack costs little, and where there are few it costs most of it. Measured
    /// on all real scenes without ids and four drives of KITTI: mean F1 .982 with 2 pixels, .994 with this rule (.993 with .9;
    /// S22 with GPS poses .832 and 1), and on 26 kinds of synthetic scenes, also of 3, 4 and 6 views: only objects that hide each
    /// other by more than .001 worse (.994 and .990).
    MIN_EVIDENCE_SHARE = 0.88;
}

/// The bits of one.
#[cfg(feature = "sensitivity")]
const ONE: u64 = 0x3FF0_0000_0000_0000;

#[cfg(feature = "sensitivity")]
static FACTORS: [AtomicU64; CONSTANTS.len()] = [const { AtomicU64::new(ONE) }; CONSTANTS.len()];

/// Scales the constant with this index into [`CONSTANTS`], for the whole process; nothing where there is none.
#[cfg(feature = "sensitivity")]
pub fn scale(index: usize, factor: f64) {
    if let Some(bits) = FACTORS.get(index) {
        bits.store(factor.to_bits(), Ordering::Relaxed);
    }
}
