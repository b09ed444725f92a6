#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]
use quadlift::geometry::*;
use quadlift::metrics::iou3d_ellipsoids;
use quadlift::solve::planes::*;
use quadlift::synthetic::*;
fn main() {
    let s = generate(&SyntheticOptions { seed: 1, observations: Observations::Boxes, ..Default::default() }).unwrap();
    let g = s.scene.detections_by_object(|_| true);
    for i in [4usize, 5, 6, 26] {
        let o = s.scene.object_views(i, &g[i]);
        let t = s.truth[i].1.ellipsoid();
        let mut w: f64 = 0.0;
        for v in &o.views {
            for e in 0..4 {
                let pl = edge_plane(v.projection.matrix(), &v.bounding_box.unwrap(), e);
                let n = pl.xyz();
                let r = (n.dot(&t.center.coords) + pl.w - t.support(&n)) / v.projection.depth(&t.center);
                w = w.max(r.abs());
            }
        }
        let q = planes(&o.views).unwrap().to_ellipsoid().unwrap();
        println!(
            "{i} worst px {w:.3e} iou {} center err {:.3e} axes err {:.3e} shape err {:.3e}",
            iou3d_ellipsoids(&q, &t),
            (q.center - t.center).norm(),
            (q.semi_axes - t.semi_axes).norm(),
            (q.shape() - t.shape()).norm()
        );
    }
}
