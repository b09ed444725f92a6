//! Frames as JSON Lines in, events as JSON Lines out: what `quadlift stream` reads and writes
//! (docs/formats/stream.md, docs/formats/stream.schema.json).
//!
//! [`parse_line`] gives one line as records, which [`StreamedScene`] checks and converts to frames of [`quadlift::online`].
//! [`StreamedScene::to_file`] makes a scene file of the map, [`StreamState`] holds what that file cannot. [`OutputLine`] is a line of the
//! output.

mod input;
mod line;
mod event;
mod map_file;
mod options;
mod scene;
mod state;

pub use event::{DetectionRecord, EventRecord, OutputLine, inconsistency_in_words};
pub use input::open;
pub use line::{AboutRecord, CameraOfFrame, FrameLine, Line, LineError, PoseRecord, parse_line, scene_to_frames};
pub use map_file::{MapMemory, MemoryRecord, ShareRecord, StreamRecord};
pub use options::{StoredPriors, lasting_options, options_of};
pub use scene::{CheckedFrame, StreamedScene};
pub use state::{StoredStream, StreamState, parse_stored_stream, read_state_file, read_stored_stream, write_state};
