//! The closed forms and the paper's regularized estimator as estimators of one object: status, residuals, warnings.

pub(crate) mod singular;
pub(crate) mod arrowhead;
pub(crate) mod pfd;
pub(crate) mod lfd;
pub(super) mod planes;
pub(crate) mod reg;

use self::lfd::lfd;
use self::pfd::{ClosedFormError, pfd};
use self::planes::planes;
use self::reg::reg;
use super::estimate::{Estimate, Status};
use super::options::Method;
use super::report::{describe, describe_center};
use crate::geometry::{Body, Ellipse, Ellipsoid, EllipsoidError, Projection};
use crate::scene::ObjectViews;

/// Solves for one object with a closed form or the paper's regularized estimator. [`Method::Posterior`] needs all objects of
/// a scene, see [`super::map`]; here it gives the result of `planes`.
pub(crate) fn solve_closed_form(object: &ObjectViews, method: &Method, with_enclosing: bool) -> Estimate {
    let blank = |status| Estimate::failed(object.object_index, object.category_index, status);
    if object.views.len() < method.min_views() {
        return blank(Status::TooFewViews);
    }
    let observations: Vec<(Projection, Ellipse)> =
        object.views.iter().filter_map(|view| Some((view.projection, view.ellipse_or_inscribed()?))).collect();
    let status = |error: ClosedFormError| match error {
        ClosedFormError::TooFewViews { .. } => Status::TooFewViews,
        ClosedFormError::Degenerate => Status::Degenerate,
    };
    let solution: Result<Result<Ellipsoid, EllipsoidError>, Status> = match method {
        Method::Planes | Method::Posterior(_) => planes(&object.views).map(|solution| solution.to_ellipsoid()),
        Method::Lfd => lfd(&observations).map(|solution| solution.to_ellipsoid()).map_err(status),
        Method::Pfd => pfd(&observations).map(|solution| solution.dual_quadric.to_ellipsoid()).map_err(status),
        Method::Reg(options) => {
            reg(&observations, options).map(|solution| solution.dual_quadric.to_ellipsoid()).map_err(status)
        }
    };
    match solution {
        Ok(Ok(ellipsoid)) => {
            let body = Body::from(ellipsoid);
            describe(blank(Status::Ok), body, &object.views, |_| true, with_enclosing)
        }
        Ok(Err(EllipsoidError::NotAnEllipsoid { center, .. })) => {
            describe_center(blank(Status::NotAnEllipsoid), center, &object.views)
        }
        Ok(Err(EllipsoidError::NotFinite)) => blank(Status::Degenerate),
        Err(status) => blank(status),
    }
}
