//! Biovision hierarchies, `.bvh`: a skeleton and its motion.
//!
//! # Theory
//! `HIERARCHY` lists joints with their offsets from their parents and the channels of each;
//! `MOTION` has a line of all channels' numbers for each frame. Rotations are in degrees; those of
//! a joint are multiplied in the order of its channels, the first one outermost. A position channel
//! replaces that component of the joint's offset.
//!
//! # Practice
//! `End Site`s become joints without channels, named after their parents with ` end`. Numbers
//! beyond the last frame, and frames fewer than the header says, are errors. Units and axes are
//! those of the file: usually y up.
//!
//! The writer writes rotations in the order z, y, x, and positions of joints with a track of
//! translations. It samples the clip at a fixed rate.

use std::fmt::Write;
use std::str::SplitWhitespace;

use forelock_core::body::character::{Clip, Interpolation, Joint, Skeleton, Track, Transform, Values};
use glam::{DQuat, DVec3, EulerRot};

use crate::error::{FormatError, Problem};

/// Joints inside joints; deeper files are refused.
const DEEPEST: usize = 512;

/// The largest length or angle of a file, in its units and degrees.
const LARGEST: f64 = 1e7;

/// A skeleton and a clip for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Bvh {
    /// The skeleton.
    pub skeleton: Skeleton,
    /// Its motion.
    pub clip: Clip,
    /// Number of frames.
    pub frames: usize,
    /// Time from a frame to the next, seconds.
    pub frame_secs: f64,
}

impl Bvh {
    /// Time of frame `frame`, seconds.
    pub fn secs(&self, frame: usize) -> f64 {
        frame as f64 * self.frame_secs
    }

    /// Times of all frames, seconds.
    pub fn times(&self) -> Vec<f64> {
        (0..self.frames).map(|frame| self.secs(frame)).collect()
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Channel {
    Position(usize),
    Rotation(usize),
}

/// The words of a file, with the lines that they are on.
struct Words<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    words: SplitWhitespace<'a>,
    line: usize,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        Self { lines: text.lines().enumerate(), words: "".split_whitespace(), line: 1 }
    }

    fn next(&mut self) -> Option<&'a str> {
        loop {
            if let Some(word) = self.words.next() {
                return Some(word);
            }
            let (line, text) = self.lines.next()?;
            self.line = line + 1;
            self.words = text.split_whitespace();
        }
    }

    /// The rest of the line.
    fn rest_of_line(&mut self) -> String {
        let words: Vec<&str> = self.words.by_ref().collect();
        words.join(" ")
    }

    fn invalid(&self, words: impl std::fmt::Display) -> FormatError {
        invalid(format!("line {}: {words}", self.line))
    }

    fn expect(&mut self, word: &str) -> Result<(), FormatError> {
        match self.next() {
            Some(found) if found.eq_ignore_ascii_case(word) => Ok(()),
            Some(found) => Err(self.invalid(format_args!("expected {word}, found {found:?}"))),
            None => Err(self.invalid(format_args!("expected {word}, found the end of the file"))),
        }
    }

    fn number(&mut self, what: &str) -> Result<f64, FormatError> {
        let Some(word) = self.next() else {
            return Err(self.invalid(format_args!("expected {what}, found the end of the file")));
        };
        // Some programs write decimal commas.
        let parsed = word.parse().or_else(|_| word.replace(',', ".").parse());
        match parsed {
            Ok(number) if f64::is_finite(number) => Ok(number),
            _ => Err(self.invalid(format_args!("expected {what}, found {word:?}"))),
        }
    }

    /// A length or an angle.
    fn measure(&mut self, what: &str) -> Result<f64, FormatError> {
        let number = self.number(what)?;
        if number.abs() <= LARGEST {
            Ok(number)
        } else {
            Err(self.invalid(format_args!("{what}: {number:e} is beyond {LARGEST:e}")))
        }
    }

    fn vector(&mut self, what: &str) -> Result<DVec3, FormatError> {
        Ok(DVec3::new(self.measure(what)?, self.measure(what)?, self.measure(what)?))
    }

    fn count(&mut self, what: &str) -> Result<usize, FormatError> {
        let number = self.number(what)?;
        if number < 0.0 || number.fract() != 0.0 || number > f64::from(u32::MAX) {
            return Err(self.invalid(format_args!("expected {what}, found {number}")));
        }
        Ok(number as usize)
    }
}

fn invalid(words: String) -> FormatError {
    FormatError { format: "BVH", offset: 0, strand: None, problem: Problem::Invalid(words) }
}

/// Reads a skeleton and its motion.
///
/// # Errors
/// [`FormatError`] if the text is not a BVH file, or a number is missing or not finite.
pub fn read(bytes: &[u8]) -> Result<Bvh, FormatError> {
    let text = String::from_utf8_lossy(bytes);
    let mut words = Words::new(text.trim_start_matches('\u{feff}'));
    words.expect("HIERARCHY")?;
    let (mut joints, mut channels) = (Vec::new(), Vec::new());
    let mut word = words.next();
    while let Some(found) = word {
        if found.eq_ignore_ascii_case("MOTION") {
            break;
        }
        if !found.eq_ignore_ascii_case("ROOT") {
            return Err(words.invalid(format_args!("expected ROOT or MOTION, found {found:?}")));
        }
        joint(&mut words, None, 0, &mut joints, &mut channels)?;
        word = words.next();
    }
    if word.is_none() {
        return Err(words.invalid("expected MOTION, found the end of the file"));
    }
    if joints.is_empty() {
        return Err(words.invalid("there is no ROOT before MOTION"));
    }
    words.expect("Frames:")?;
    let frames = words.count("the number of frames")?;
    words.expect("Frame")?;
    words.expect("Time:")?;
    let frame_secs = words.measure("the time of a frame in seconds")?;
    if frames == 0 || frame_secs <= 0.0 {
        return Err(words.invalid(format_args!("{frames} frames of {frame_secs} s are no motion")));
    }
    let numbers = channels.len().max(1);
    // Every number takes two bytes at least.
    let needed = (frames as u64).saturating_mul(numbers as u64).saturating_mul(2);
    if needed > bytes.len() as u64 + 1 {
        let problem = Problem::Short { what: "the frames", needed, left: bytes.len() as u64 };
        return Err(FormatError { format: "BVH", offset: 0, strand: None, problem });
    }
    let clip = motion(&mut words, &joints, &channels, frames, frame_secs)?;
    if let Some(word) = words.next() {
        return Err(words.invalid(format_args!("{word:?} is beyond the last of {frames} frames")));
    }
    let skeleton = Skeleton::new(joints).map_err(|error| invalid(error.to_string()))?;
    Ok(Bvh { skeleton, clip, frames, frame_secs })
}

/// Reads a joint after its keyword, and its children.
fn joint(
    words: &mut Words<'_>,
    parent: Option<usize>,
    depth: usize,
    joints: &mut Vec<Joint>,
    channels: &mut Vec<(usize, Channel)>,
) -> Result<(), FormatError> {
    if depth > DEEPEST {
        return Err(words.invalid(format_args!("joints are nested more than {DEEPEST} deep")));
    }
    let name = words.rest_of_line();
    let name = match name.strip_suffix('{') {
        Some(name) => name.trim_end().to_owned(),
        None => {
            words.expect("{")?;
            name
        }
    };
    let own = joints.len();
    let first = channels.len();
    joints.push(Joint { name, parent, rest: Transform::IDENTITY });
    let mut has_channels = false;
    loop {
        let Some(word) = words.next() else {
            let name = &joints[own].name;
            return Err(words.invalid(format_args!("joint {name:?} is not closed by a brace")));
        };
        match word.to_ascii_uppercase().as_str() {
            "OFFSET" => joints[own].rest.translation = words.vector("an offset of three numbers")?,
            "CHANNELS" if !has_channels => {
                has_channels = true;
                for _ in 0..words.count("the number of channels")? {
                    let channel = channel(words)?;
                    if channels[first..].contains(&(own, channel)) {
                        return Err(words.invalid("a joint has a channel twice"));
                    }
                    channels.push((own, channel));
                }
            }
            "JOINT" => joint(words, Some(own), depth + 1, joints, channels)?,
            "END" => {
                words.expect("Site")?;
                words.expect("{")?;
                words.expect("OFFSET")?;
                let translation = words.vector("an offset of three numbers")?;
                words.expect("}")?;
                let name = format!("{} end", joints[own].name);
                let rest = Transform { translation, ..Transform::IDENTITY };
                joints.push(Joint { name, parent: Some(own), rest });
            }
            "}" => return Ok(()),
            _ => {
                let expected = "OFFSET, CHANNELS, JOINT, End Site or }";
                return Err(words.invalid(format_args!("expected {expected}, found {word:?}")));
            }
        }
    }
}

fn channel(words: &mut Words<'_>) -> Result<Channel, FormatError> {
    let word = words.next().unwrap_or("the end of the file");
    let axis = word.bytes().next().map(|axis| axis.to_ascii_uppercase());
    let axis = axis.filter(u8::is_ascii_alphabetic).map(|axis| usize::from(axis.wrapping_sub(b'X')));
    let kind = word.get(1..).unwrap_or_default().to_ascii_lowercase();
    match (axis, kind.as_str()) {
        (Some(axis @ 0..3), "position") => Ok(Channel::Position(axis)),
        (Some(axis @ 0..3), "rotation") => Ok(Channel::Rotation(axis)),
        _ => Err(words.invalid(format_args!("expected a channel (Xposition to Zrotation), found {word:?}"))),
    }
}

/// Reads the frames.
fn motion(
    words: &mut Words<'_>,
    joints: &[Joint],
    channels: &[(usize, Channel)],
    frames: usize,
    frame_secs: f64,
) -> Result<Clip, FormatError> {
    let mut places: Vec<Vec<DVec3>> = vec![Vec::new(); joints.len()];
    let mut turns: Vec<Vec<DQuat>> = vec![Vec::new(); joints.len()];
    for frame in 0..frames {
        for own in channels.chunk_by(|a, b| a.0 == b.0) {
            let joint = own[0].0;
            let (mut place, mut turn) = (joints[joint].rest.translation, DQuat::IDENTITY);
            let (mut moves, mut turned) = (false, false);
            for &(_, channel) in own {
                let number = words.measure("a number of a frame").map_err(|mut error| {
                    if let Problem::Invalid(text) = &mut error.problem {
                        let _ = write!(text, " (frame {} of {frames})", frame + 1);
                    }
                    error
                })?;
                match channel {
                    Channel::Position(axis) => (place[axis], moves) = (number, true),
                    Channel::Rotation(axis) => {
                        let about = DQuat::from_axis_angle(DVec3::AXES[axis], number.to_radians());
                        (turn, turned) = (turn * about, true);
                    }
                }
            }
            if moves {
                places[joint].push(place);
            }
            if turned {
                turns[joint].push(turn.normalize());
            }
        }
    }
    let times: Vec<f64> = (0..frames).map(|frame| frame as f64 * frame_secs).collect();
    let track = |joint: usize, values: Values| Track {
        joint,
        times: times.clone(),
        interpolation: Interpolation::Linear,
        values,
    };
    let mut tracks = Vec::new();
    for (joint, (places, turns)) in places.into_iter().zip(turns).enumerate() {
        if !places.is_empty() {
            tracks.push(track(joint, Values::Translation(places)));
        }
        if !turns.is_empty() {
            tracks.push(track(joint, Values::Rotation(turns)));
        }
    }
    Ok(Clip { name: String::new(), tracks })
}

/// The bytes of `clip` of `skeleton`, in `frames` frames of `frame_secs` seconds.
///
/// Rest rotations and scales of joints, which the format does not have, are in the motion and lost,
/// in this order.
pub fn write(skeleton: &Skeleton, clip: &Clip, frames: usize, frame_secs: f64) -> Vec<u8> {
    let moves = |joint: usize| {
        clip.tracks.iter().any(|own| own.joint == joint && matches!(own.values, Values::Translation(_)))
    };
    let joints = skeleton.joints();
    let turned = |joint: usize| {
        joints[joint].rest.rotation != DQuat::IDENTITY
            || clip.tracks.iter().any(|own| own.joint == joint && matches!(own.values, Values::Rotation(_)))
    };
    let children =
        |joint: usize| (joint + 1..joints.len()).filter(move |&own| joints[own].parent == Some(joint));
    let is_end = |joint: usize| {
        joints[joint].parent.is_some() && children(joint).next().is_none() && !moves(joint) && !turned(joint)
    };
    let mut text = String::from("HIERARCHY\n");
    let mut order = Vec::new();
    // Joints to be written, and braces to be closed, the next one last.
    let mut stack: Vec<(usize, usize, bool)> = Vec::new();
    stack.extend(
        (0..joints.len()).rev().filter(|&own| joints[own].parent.is_none()).map(|own| (own, 0, false)),
    );
    while let Some((own, depth, is_close)) = stack.pop() {
        let tabs = "\t".repeat(depth);
        if is_close {
            let _ = writeln!(text, "{tabs}}}");
            continue;
        }
        let joint = &joints[own];
        let [x, y, z] = joint.rest.translation.to_array();
        let head = match (joint.parent, is_end(own)) {
            (None, _) => format!("ROOT {}", joint.name),
            (_, true) => "End Site".to_owned(),
            (_, false) => format!("JOINT {}", joint.name),
        };
        let _ = writeln!(text, "{tabs}{head}\n{tabs}{{\n{tabs}\tOFFSET {x} {y} {z}");
        if !is_end(own) {
            let positions = if moves(own) { "6 Xposition Yposition Zposition" } else { "3" };
            let _ = writeln!(text, "{tabs}\tCHANNELS {positions} Zrotation Yrotation Xrotation");
            order.push(own);
        }
        stack.push((own, depth, true));
        stack.extend(children(own).collect::<Vec<_>>().into_iter().rev().map(|own| (own, depth + 1, false)));
    }
    let _ = writeln!(text, "MOTION\nFrames: {frames}\nFrame Time: {frame_secs}");
    let mut locals = skeleton.rest();
    for frame in 0..frames {
        clip.sample(frame as f64 * frame_secs, &mut locals, &mut []);
        for (i, &own) in order.iter().enumerate() {
            let local = &locals[own];
            let gap = if i == 0 { "" } else { " " };
            text.push_str(gap);
            if moves(own) {
                let [x, y, z] = local.translation.to_array();
                let _ = write!(text, "{x} {y} {z} ");
            }
            let (z, y, x) = local.rotation.to_euler(EulerRot::ZYX);
            let [z, y, x] = [z, y, x].map(f64::to_degrees);
            let _ = write!(text, "{z} {y} {x}");
        }
        text.push('\n');
    }
    text.into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "HIERARCHY
ROOT Hips
{
  OFFSET 0 1 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Upper Arm {
    OFFSET 1 0 0
    CHANNELS 2 Yrotation Xrotation
    End Site
    {
      OFFSET 0 0,5 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.5
1 2 3 90 0 0 0 90
4 5 6 0 0 90 90 0
";

    #[test]
    fn channels_are_applied_in_their_order() {
        let own = read(TEXT.as_bytes()).unwrap();
        let names: Vec<&str> = own.skeleton.joints().iter().map(|joint| joint.name.as_str()).collect();
        assert_eq!(names, ["Hips", "Upper Arm", "Upper Arm end"]);
        assert_eq!((own.frames, own.frame_secs, own.clip.duration_secs()), (2, 0.5, 0.5));
        let at = |secs: f64| {
            let (mut locals, mut globals) = (own.skeleton.rest(), Vec::new());
            own.clip.sample(secs, &mut locals, &mut []);
            own.skeleton.globals(&locals, &mut globals);
            globals.iter().map(|global| global.translation).collect::<Vec<_>>()
        };
        let near = |a: DVec3, b: [f64; 3]| assert!(a.distance(b.into()) < 1e-12, "{a} {b:?}");
        let [hips, arm, end] = *at(0.0) else { panic!() };
        near(hips, [1.0, 2.0, 3.0]);
        near(arm, [1.0, 3.0, 3.0]);
        near(end, [1.0, 3.0, 3.5]);
        let [hips, arm, end] = *at(0.5) else { panic!() };
        near(hips, [4.0, 5.0, 6.0]);
        near(arm, [4.0, 5.0, 5.0]);
        near(end, [4.0, 5.5, 5.0]);
    }

    #[test]
    fn what_is_written_reads_as_the_same_motion() {
        let own = read(TEXT.as_bytes()).unwrap();
        let bytes = write(&own.skeleton, &own.clip, own.frames, own.frame_secs);
        let back = read(&bytes).unwrap();
        assert_eq!(own.skeleton, back.skeleton);
        assert_eq!(write(&back.skeleton, &back.clip, back.frames, back.frame_secs).len(), bytes.len());
        let (mut a, mut b) = (own.skeleton.rest(), own.skeleton.rest());
        for secs in [0.0, 0.2, 0.5] {
            own.clip.sample(secs, &mut a, &mut []);
            back.clip.sample(secs, &mut b, &mut []);
            for (a, b) in a.iter().zip(&b) {
                assert!(a.affine().abs_diff_eq(b.affine(), 1e-12));
            }
        }
    }

    #[test]
    fn errors_name_the_line() {
        for (from, to, expected) in [
            ("HIERARCHY", "HIERARCH", "line 1: expected HIERARCHY, found \"HIERARCH\""),
            ("OFFSET 1 0 0", "OFFSET 1 0", "line 8: expected an offset of three numbers, found \"CHANNELS\""),
            ("Yrotation Xrotation\n", "Yrotation Xrotatio\n", "found \"Xrotatio\""),
            ("MOTION", "MOTIO", "line 15: expected ROOT or MOTION, found \"MOTIO\""),
            (
                "Frames: 2",
                "Frames: 3",
                "expected a number of a frame, found the end of the file (frame 3 of 3)",
            ),
            ("Frames: 2", "Frames: 1", "line 19: \"4\" is beyond the last of 1 frames"),
            ("Frames: 2", "Frames: 2000000000", "the frames take"),
            ("Frame Time: 0.5", "Frame Time: 0", "2 frames of 0 s are no motion"),
            (
                "90 0 0 0 90",
                "90 0 nan 0 90",
                "line 18: expected a number of a frame, found \"nan\" (frame 1 of 2)",
            ),
            (
                "90 0 0 0 90",
                "90 0 1e30 0 90",
                "line 18: a number of a frame: 1e30 is beyond 1e7 (frame 1 of 2)",
            ),
            (
                "  }\n}\nMOTION",
                "  }\nMOTION",
                "line 14: expected OFFSET, CHANNELS, JOINT, End Site or }, found",
            ),
        ] {
            let text = TEXT.replacen(from, to, 1);
            assert_ne!(text, TEXT, "{from}");
            let error = read(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(expected), "{error:?} has no {expected:?}");
        }
        let deep = format!("HIERARCHY\nROOT a {{\n{}", "JOINT b {\n".repeat(100_000));
        assert!(read(deep.as_bytes()).unwrap_err().to_string().contains("nested"));
    }
}
