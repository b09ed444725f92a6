//! `quadlift._core`: the library and the files as Python objects and NumPy arrays. The public API, with its checks of
//! shapes and its documentation, is the Python package `quadlift` (python/quadlift) over it.

mod error;
mod evaluation;
mod frames;
mod live;
mod program;
mod rows;
mod calibrate_rig;
mod cues;
mod relocalize;
mod outlines;
mod detections;
mod loaded;
mod recording;
mod render;
mod run;
mod scene;
mod options;
mod association;
mod formats;
mod localized;
mod object_map;
mod segmentation;
mod scene_methods;

use pyo3::prelude::*;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("QuadliftError", module.py().get_type::<error::QuadliftError>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(program::run_program, module)?)?;
    module.add_function(wrap_pyfunction!(segmentation::set_max_pixels, module)?)?;
    module.add_function(wrap_pyfunction!(scene_methods::write_text, module)?)?;
    module.add_function(wrap_pyfunction!(scene_methods::frame_problems, module)?)?;
    module.add_function(wrap_pyfunction!(formats::format_options, module)?)?;
    module.add_function(wrap_pyfunction!(detections::occluded_edges, module)?)?;
    module.add_function(wrap_pyfunction!(outlines::occluded_lines, module)?)?;
    module.add_function(wrap_pyfunction!(calibrate_rig::calibrate_rig, module)?)?;
    module.add_class::<scene::PyScene>()?;
    module.add_class::<localized::PyLocalized>()?;
    module.add_class::<object_map::PyObjectMap>()?;
    Ok(())
}
