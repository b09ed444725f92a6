//! The closed forms and the paper's regularised estimator as estimators of one object: status, residuals, warnings.

use super::estimate::{Estimate, Status};
use super::options::{Method, RegOptions};
use super::planes::planes;
use super::report::{describe, describe_center};
use crate::geometry::{Body, DualQuadric, EllipsoidError};
use crate::scene::ObjectViews;

/// Solves for one object with [`Method::Planes`], [`Method::Lfd`], [`Method::Pfd`] or [`Method::Reg`].
pub fn solve_closed_form(object: &ObjectViews, method: Method, _reg: &RegOptions, enclosing_quantile: f64) -> Estimate {
    let blank = |status| Estimate::failed(object.object_index, object.category_index, status);
    if object.views.len() < method.fewest_views() {
        return blank(Status::TooFewViews);
    }
    let solution: Result<DualQuadric, Status> = match method {
        Method::Planes | Method::Map => planes(&object.views),
        Method::Lfd | Method::Pfd | Method::Reg => Err(Status::Degenerate),
    };
    let quadric = match solution {
        Ok(quadric) => quadric,
        Err(status) => return blank(status),
    };
    match quadric.to_ellipsoid() {
        Ok(ellipsoid) => {
            let body = Body::Ellipsoid(ellipsoid);
            describe(blank(Status::Ok), body, &object.views, |_| true, enclosing_quantile)
        }
        Err(EllipsoidError::NotAnEllipsoid { center, .. }) => {
            describe_center(blank(Status::NotAnEllipsoid), center, &object.views)
        }
        Err(EllipsoidError::NotFinite) => blank(Status::Degenerate),
    }
}
