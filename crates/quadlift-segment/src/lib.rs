//! Object masks from images by co-segmentation, and ellipses from masks.
#![forbid(unsafe_code)]
