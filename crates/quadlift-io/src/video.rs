//! Frames of videos as images, read with the program `ffmpeg`.
//!
//! A frame of a scene names one as `drive.mp4#frame=12` (number of the frame, from 0) or `drive.mp4#t=0.48` (seconds from
//! the start, as in *Media Fragments URI 1.0* of the W3C). All frames that a scene needs of a video are decoded in one
//! process, into a temporary folder; memory holds one image at a time.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::ReadError;
use crate::images::max_pixels;
use crate::input::check_readable;
use crate::temporary::Temporary;

/// Most ranges of frames that the filter of a process selects; near ranges are joined beyond it.
const MAX_RANGES: usize = 400;

/// Numbers of frames are below it: a year of video has fewer.
const MAX_FRAMES: u64 = 1 << 31;

/// Frames per second of the images that are written: a number without a meaning, so that none is dropped or repeated.
const RATE: u32 = 25;

/// Which frame of a video.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VideoTime {
    /// The number of the frame, from 0.
    Frame(u64),
    /// Seconds from the first frame; the nearest frame.
    Seconds(f64),
}

/// The video and the frame that an image's path means, if it means one.
pub fn frame_of_video(path: &Path) -> Option<(&Path, VideoTime)> {
    let (video, fragment) = path.to_str()?.rsplit_once('#')?;
    let time = match fragment.split_once('=')? {
        ("frame", number) => VideoTime::Frame(number.parse().ok().filter(|number| *number < MAX_FRAMES)?),
        ("t", seconds) => VideoTime::Seconds(seconds.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0)?),
        _ => return None,
    };
    (!video.is_empty()).then_some((Path::new(video), time))
}

/// The file of an image: that of the video for one of its frames.
pub(crate) fn file_of_image(path: &Path) -> &Path {
    frame_of_video(path).map_or(path, |(video, _)| video)
}

/// The frames of videos that have been decoded for a scene. Copies share them; the files are removed with the last one.
#[derive(Clone, Default)]
pub struct VideoFrames(Arc<Mutex<Decoded>>);

#[derive(Default)]
struct Decoded {
    /// Frames of the scene that will be read, if that is known.
    wanted: Option<BTreeSet<usize>>,
    videos: HashMap<PathBuf, Result<Frames, ReadError>>,
}

/// Decoded frames of a video.
struct Frames {
    folder: Temporary,
    /// Number of the image of each frame.
    image_of: BTreeMap<u64, u64>,
    /// For each time that was asked for, by its bits, the number of the frame, or the problem.
    frame_at: HashMap<u64, Result<u64, String>>,
}

impl fmt::Debug for VideoFrames {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("VideoFrames").finish_non_exhaustive()
    }
}

/// What has been decoded is no part of the content of a scene.
impl PartialEq for VideoFrames {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl VideoFrames {
    /// Restricts what is decoded to these frames of the scene; without it all of its images are.
    pub fn want(&self, frames: impl IntoIterator<Item = usize>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).wanted = Some(frames.into_iter().collect());
    }

    /// The image file of a frame of a video; `images` are those of the scene, of which all needed ones are decoded
    /// at the first call.
    pub(crate) fn image(
        &self,
        frame_index: usize,
        (video, time): (&Path, VideoTime),
        images: &[Option<PathBuf>],
    ) -> Result<PathBuf, ReadError> {
        let mut decoded = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Decoded { wanted, videos } = &mut *decoded;
        let has = |frames: &Frames| match frames.number(time) {
            Some(Ok(number)) => frames.image_of.contains_key(&number),
            found => found.is_some(),
        };
        if videos.get(video).is_none_or(|frames| frames.as_ref().is_ok_and(|frames| !has(frames))) {
            let is_wanted =
                |index: &usize| *index == frame_index || wanted.as_ref().is_none_or(|wanted| wanted.contains(index));
            let images = images.iter().enumerate().filter(|(index, _)| is_wanted(index));
            let places = images.filter_map(|(_, image)| frame_of_video(image.as_deref()?));
            let times: Vec<VideoTime> =
                places.filter(|(other, _)| *other == video).map(|(_, time)| time).chain([time]).collect();
            videos.insert(video.to_owned(), decode(video, &times));
        }
        let frames = match &videos[video] {
            Ok(frames) => frames,
            Err(error) => return Err(error.clone()),
        };
        let number = frames.number(time).unwrap_or(Ok(0)).map_err(|problem| ReadError::new(video, problem))?;
        let image = frames.image_of.get(&number).copied().unwrap_or_default();
        let path = frames.folder.path().join(file_name(image));
        if path.is_file() {
            Ok(path)
        } else {
            Err(ReadError::new(video, format!("the video ends before frame {number} (numbers count from 0)")))
        }
    }
}

impl Frames {
    /// The number of the frame at a time, or why there is none; `None` if the time was not asked for.
    fn number(&self, time: VideoTime) -> Option<Result<u64, String>> {
        match time {
            VideoTime::Frame(number) => Some(Ok(number)),
            VideoTime::Seconds(seconds) => self.frame_at.get(&seconds.to_bits()).cloned(),
        }
    }
}

/// Decodes frames of a video in one process.
fn decode(video: &Path, times: &[VideoTime]) -> Result<Frames, ReadError> {
    check_readable(video)?;
    let mut frame_at = HashMap::new();
    if times.iter().any(|time| matches!(time, VideoTime::Seconds(_))) {
        let starts = frame_starts(video)?;
        for time in times {
            let VideoTime::Seconds(seconds) = time else { continue };
            frame_at.insert(seconds.to_bits(), nearest(&starts, *seconds));
        }
    }
    let number = |time: &VideoTime| match time {
        VideoTime::Frame(number) => Some(*number),
        VideoTime::Seconds(seconds) => frame_at.get(&seconds.to_bits())?.as_ref().ok().copied(),
    };
    let numbers: BTreeSet<u64> = times.iter().filter_map(number).collect();
    let failed = |error: io::Error| ReadError::new(video, format!("cannot make a temporary folder: {error}"));
    let folder = Temporary::folder_in(&std::env::temp_dir()).map_err(failed)?;
    if numbers.is_empty() {
        return Ok(Frames { folder, image_of: BTreeMap::new(), frame_at });
    }
    let ranges = ranges(&numbers);
    // Images have the numbers of the frames among those that are selected, from 1.
    let (mut selected, mut image_of) = (0_u64, BTreeMap::new());
    for [first, last] in &ranges {
        image_of.extend(numbers.range(first..=last).map(|number| (*number, selected + number - first + 1)));
        selected = selected.saturating_add(last - first + 1);
    }
    let selection: Vec<String> = ranges.iter().map(|[first, last]| format!("between(n,{first},{last})")).collect();
    let mut command = tool("ffmpeg", video)?;
    command
        .args(["-map", "0:V:0", "-vf"])
        .arg(format!("select='{}',setpts=N/({RATE}*TB)", selection.join("+")))
        .args(["-r", &RATE.to_string(), "-frames:v", &selected.to_string()])
        .args(["-c:v", "mjpeg", "-q:v", "2", "-pix_fmt", "yuvj420p", "-f", "image2", "%d.jpg"])
        .current_dir(folder.path());
    let output = run(&mut command, "ffmpeg", video)?;
    if !output.status.success() && !folder.path().join(file_name(1)).is_file() {
        return Err(ReadError::new(video, format!("ffmpeg cannot read the video: {}", last_line(&output.stderr))));
    }
    Ok(Frames { folder, image_of, frame_at })
}

/// Name of an image in the temporary folder.
fn file_name(number: u64) -> String {
    format!("{number}.jpg")
}

/// Frames as few ranges `[first, last]`, in their order.
fn ranges(frames: &BTreeSet<u64>) -> Vec<[u64; 2]> {
    let mut ranges: Vec<[u64; 2]> = Vec::new();
    for &frame in frames {
        match ranges.last_mut() {
            Some([_, last]) if frame - *last == 1 => *last = frame,
            _ => ranges.push([frame, frame]),
        }
    }
    if ranges.len() > MAX_RANGES {
        // The widest gaps stay.
        let gap = |pair: &[[u64; 2]]| pair[1][0] - pair[0][1];
        let mut gaps: Vec<u64> = ranges.windows(2).map(gap).collect();
        gaps.sort_unstable_by(|a, b| b.cmp(a));
        let (joined, mut kept) = (std::mem::take(&mut ranges), 1);
        for range in joined {
            match ranges.last_mut() {
                Some([_, last]) if range[0] - *last < gaps[MAX_RANGES - 2] || kept == MAX_RANGES => *last = range[1],
                previous => {
                    kept += usize::from(previous.is_some());
                    ranges.push(range);
                }
            }
        }
    }
    ranges
}

/// The times of the frames in seconds from the first one, in the order of the times.
fn frame_starts(video: &Path) -> Result<Vec<f64>, ReadError> {
    let mut command = tool("ffprobe", video)?;
    command.args(["-select_streams", "V:0", "-show_entries", "packet=pts_time,flags", "-of", "csv=p=0"]);
    let output = run(&mut command, "ffprobe", video)?;
    let text = String::from_utf8_lossy(&output.stdout);
    // Packets with the flag D are not shown.
    let shown = text.lines().filter_map(|line| line.split_once(',')).filter(|(_, flags)| !flags.contains('D'));
    let mut times: Vec<f64> = shown.filter_map(|(time, _)| time.parse().ok()).filter(|x: &f64| x.is_finite()).collect();
    times.sort_by(f64::total_cmp);
    let Some(&first) = times.first() else {
        return Err(ReadError::new(video, format!("ffprobe finds no frames: {}", last_line(&output.stderr))));
    };
    Ok(times.iter().map(|time| time - first).collect())
}

/// The frame that is shown at, or starts nearest to, a time.
fn nearest(starts: &[f64], seconds: f64) -> Result<u64, String> {
    let after = starts.partition_point(|start| *start < seconds);
    let candidates = after.saturating_sub(1)..(after + 1).min(starts.len());
    let last = starts.last().copied().unwrap_or_default();
    let interval = last / (starts.len().max(2) - 1) as f64;
    match candidates.min_by(|a, b| (starts[*a] - seconds).abs().total_cmp(&(starts[*b] - seconds).abs())) {
        Some(frame) if seconds <= last + interval => Ok(frame as u64),
        _ => Err(format!("there is no frame at {seconds} s: the last one is at {last} s")),
    }
}

/// With the value `off`, frames of videos are not read: decoders of videos are programs of their own.
const SWITCH: &str = "QUADLIFT_FFMPEG";

/// A program of ffmpeg that reads a video: local files only, images of the largest size that is read.
fn tool(program: &str, video: &Path) -> Result<Command, ReadError> {
    let failed = |error: io::Error| ReadError::new(video, format!("cannot read the file: {error}"));
    if std::env::var_os(SWITCH).is_some_and(|value| value == "off") {
        return Err(ReadError::new(video, format!("frames of videos are not read, because {SWITCH} is \"off\"")));
    }
    // The name may begin as an option or an address does.
    let mut file = std::ffi::OsString::from("file:");
    file.push(video.canonicalize().map_err(failed)?);
    let mut command = Command::new(program);
    command.args(["-v", "error", "-protocol_whitelist", "file,crypto,data", "-max_pixels", &max_pixels().to_string()]);
    if program == "ffmpeg" {
        command.arg("-nostdin");
    }
    command.arg("-i").arg(file).stdin(Stdio::null());
    Ok(command)
}

fn run(command: &mut Command, program: &str, video: &Path) -> Result<Output, ReadError> {
    command.output().map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => {
            let name = video.file_name().unwrap_or_default().to_string_lossy();
            ReadError::new(
                video,
                format!(
                    "frames of videos are read with {program}, which is not installed: install ffmpeg (apt install ffmpeg, \
                     brew install ffmpeg, winget install ffmpeg), or write the frames with it elsewhere and name them in \
                     the scene (ffmpeg -i {name} -start_number 0 frames/%06d.png)"
                ),
            )
        }
        _ => ReadError::new(video, format!("cannot start {program}: {error}")),
    })
}

/// What a program said last.
fn last_line(text: &[u8]) -> String {
    let text = String::from_utf8_lossy(text);
    text.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or("it gave no reason").to_owned()
}

#[cfg(test)]
#[path = "video_tests.rs"]
mod tests;
