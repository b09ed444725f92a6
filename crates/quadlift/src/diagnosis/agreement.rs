//! How well the boxes of a scene agree, and how much better they do after a correction.

/// Minimum number of boxes of a sample.
pub(crate) const MIN_BOXES: usize = 8;

/// A correction explains a disagreement when it makes the misses smaller by this factor (a logarithm: 1.28 times)...
const EXPLAINS: f64 = 0.25;

/// ...and by so many standard deviations of that, from the differences between objects...
const SIGNIFICANT: f64 = 4.0;

/// ...or nearly all objects gain.
const UNANIMOUS: f64 = 0.97;

/// From so many boxes and objects on; with fewer it must explain more, and all objects must gain.
const ENOUGH_BOXES: usize = 20;
const ENOUGH_OBJECTS: usize = 4;
const EXPLAINS_FEW_OBJECTS: f64 = 0.6;
const EXPLAINS_FEW_BOXES: f64 = 0.9;

/// A significant correction that reduces the misses by this (a logarithm) gives a warning.
const WORTH_A_WARNING: f64 = 0.1;

/// After a correction that explains a disagreement the boxes agree.
const AGREES: f64 = 0.5;

/// It makes the typical miss smaller by that factor, too, or leaves at most this share of the boxes that do not agree...
const UNEXPLAINED: f64 = 1.0 / 3.0;

/// ...and this share of all boxes: what only moves wrong boxes a little explains nothing.
const FEW_WRONG: f64 = 0.05;

/// How consistent a scene is.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Agreement {
    /// Typical distance between the middle of a box and the object's projected center, in half sizes of the box: the
    /// scale of a distribution with heavy tails (Student's t, two degrees of freedom), between 0.003 and 3.
    pub miss: f64,
    /// Share of the boxes that miss by less than half of their half size, in [0, 1].
    pub share: f64,
    /// Number of boxes used.
    pub boxes: usize,
}

impl Default for Agreement {
    /// Of no boxes, none of which misses.
    fn default() -> Self {
        Self { miss: 0.0, share: 1.0, boxes: 0 }
    }
}

/// How much better a hypothesis explains the boxes of a sample.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Improvement {
    pub before: Agreement,
    pub after: Agreement,
    /// The mean decrease of half the negative log likelihood of a box, which is about that of the logarithm of its miss.
    pub gain: f64,
    /// Its standard deviation, from the differences between objects (the boxes of an object err together).
    pub sd: f64,
    /// Fraction of all changes, summed over the objects, that are improvements, in [0, 1].
    pub unanimity: f64,
}

impl Improvement {
    /// Whether the hypothesis is accepted, given these numbers of boxes and objects.
    pub(crate) fn explains(&self, boxes: usize, objects: usize) -> bool {
        let [wrong_before, wrong_after] = [self.before, self.after].map(|agreement| 1.0 - agreement.share);
        let explains_enough = wrong_after <= UNEXPLAINED * wrong_before + FEW_WRONG
            || self.after.miss.ln() <= self.before.miss.ln() - EXPLAINS;
        if self.after.miss > AGREES || !explains_enough || boxes < MIN_BOXES {
            return false;
        }
        if boxes >= ENOUGH_BOXES && objects >= ENOUGH_OBJECTS {
            return self.gain >= EXPLAINS && (self.gain >= SIGNIFICANT * self.sd || self.unanimity >= UNANIMOUS);
        }
        let least = if boxes >= ENOUGH_BOXES { EXPLAINS_FEW_OBJECTS } else { EXPLAINS_FEW_BOXES };
        self.gain >= least && self.unanimity >= UNANIMOUS
    }

    /// Whether the hypothesis is plausible.
    pub(crate) fn is_likely(&self, boxes: usize, objects: usize) -> bool {
        let enough = boxes >= ENOUGH_BOXES && objects >= ENOUGH_OBJECTS;
        enough && self.gain >= WORTH_A_WARNING && self.gain >= SIGNIFICANT * self.sd && self.unanimity >= UNANIMOUS
    }
}
