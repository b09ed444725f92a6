//! Errors of experiments.

use std::path::PathBuf;

use quadlift::LocalizeError;
use quadlift::association::AssociateError;
use quadlift::geometry::CameraError;
use quadlift::scene::SceneError;
use quadlift::synthetic::SyntheticError;
use quadlift_io::ReadError;
use quadlift_segment::{CropError, SegmentError};

/// Why an experiment cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The real data is not there.
    #[error(
        "there is no real data: {} has no folder \"scenes\"; set the data folder with --data DIR or the environment \
         variable QUADLIFT_DATA (only the experiments \"synthetic\", \"segmentation\", \"association\" and \"trust\" \
         run without)", .0.display()
    )]
    NoData(PathBuf),
    /// A scene file cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A changed scene is not valid.
    #[error("cannot change a scene: {0}")]
    Scene(#[from] SceneError),
    /// The options do not fit a scene.
    #[error(transparent)]
    Localize(#[from] LocalizeError),
    /// The options of an association do not fit a scene.
    #[error(transparent)]
    Associate(#[from] AssociateError),
    /// A synthetic scene cannot be made.
    #[error("cannot make a synthetic scene: {0}")]
    Synthetic(#[from] SyntheticError),
    /// A camera of a synthetic scene is not valid.
    #[error("cannot make a camera: {0}")]
    Camera(#[from] CameraError),
    /// A crop of a rendered image cannot be cut.
    #[error("cannot cut a crop: {0}")]
    Crop(#[from] CropError),
    /// The options of a segmentation are wrong.
    #[error("cannot segment: {0}")]
    Segment(#[from] SegmentError),
    /// A plot cannot be drawn.
    #[error("cannot draw the plot \"{plot}\": {reason}")]
    Plot {
        /// Name of the plot.
        plot: String,
        /// The message of the drawing library.
        reason: String,
    },
}
