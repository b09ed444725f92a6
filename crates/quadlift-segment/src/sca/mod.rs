//! Stel Component Analysis (Jojic, Perina, Cristani, Murino, Frey, CVPR 2009), our variant (docs/method.md, section 18).
//!
//! The crops of an object (frames t, pixels i) are explained by *stels*, regions s that have a palette of colors
//! each; stel 0 begins as the object, the others as background. Where the stels are is shared by the frames:
//! *components* k, poses of the object, hold a probability `r[k][s][i]` for each pixel, and a frame mixes them with
//! its weights `y[t][k]`. The colors are each frame's own, but tied to those of all frames:
//! ```text
//! p(s_i^t = s) = sum_k y_k^t r_{k,s,i}                        p(z_i^t | s) = sum_g w_{s,g}^t N(z; mu, Sigma)
//! F = sum_{t,i} -log sum_s p_s b_s^eta - nu sum p0 log r      (lower is better; eta tempers correlated pixels)
//! ```
//! Variational EM: exact posteriors of the stels, point estimates of everything else.

mod options;
mod stels;
mod model;
mod expectation;
mod components;
mod maximization;
mod fit;

pub(crate) use fit::{EXCLUDED, fit};
pub use options::ScaOptions;

#[cfg(test)]
mod tests;
