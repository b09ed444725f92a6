//! `quadlift._core`: the library and the files as Python objects and NumPy arrays. The public API, with its checks of
//! shapes and its documentation, is the Python package `quadlift` (python/quadlift) over it.

mod association;
mod calibrate;
mod cues;
mod detections;
mod error;
mod evaluation;
mod formats;
mod frames;
mod live;
mod loaded;
mod localized;
mod locate;
mod object_map;
mod options;
mod outlines;
mod recording;
mod render;
mod rows;
mod run;
mod scene;
mod scene_methods;
mod segmentation;

use pyo3::prelude::*;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("QuadliftError", module.py().get_type::<error::QuadliftError>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(segmentation::set_max_pixels, module)?)?;
    module.add_function(wrap_pyfunction!(scene_methods::write_text, module)?)?;
    module.add_function(wrap_pyfunction!(scene_methods::frame_problems, module)?)?;
    module.add_function(wrap_pyfunction!(formats::format_options, module)?)?;
    module.add_function(wrap_pyfunction!(detections::hidden_edges, module)?)?;
    module.add_function(wrap_pyfunction!(outlines::hidden_lines, module)?)?;
    module.add_function(wrap_pyfunction!(calibrate::calibrate, module)?)?;
    module.add_class::<scene::PyScene>()?;
    module.add_class::<localized::PyLocalized>()?;
    module.add_class::<object_map::PyObjectMap>()?;
    Ok(())
}
