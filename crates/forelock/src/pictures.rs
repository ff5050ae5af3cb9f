//! Pictures of a scene: one of a moment, a sheet of many, a film.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use forelock_io::Cache;
use forelock_render::{
    Body, Camera, Face, Film, HAIR_WIDTH, HairColour, Image, ImageError, Labelled, RenderError, Scalp,
    Settings, Strands, contact_sheet,
};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::assets::Assets;
use crate::painter::GpuPainter;
use crate::progress::{Observer, Progress};
use crate::scalp::Cover;
use crate::scene::{CameraSection, HairSection, Scene};

/// Pictures on a contact sheet of a cache, and in a row of it.
const SHEET: (usize, u32) = (12, 4);

/// The share of the hair's colour in that of skin on which hair grows.
const SCALP: f32 = 0.6;

/// Moments at which the camera looks where the body is.
const MOMENTS: u32 = 256;

/// Why a picture cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The scene cannot be drawn.
    #[error("the picture cannot be drawn: {0}")]
    Render(#[from] RenderError),
    /// There is no GPU, or it failed.
    #[error(transparent)]
    NoGpu(#[from] forelock_gpu::GpuError),
    /// The GPU cannot draw the scene.
    #[error("the GPU cannot draw the picture: {0}")]
    Gpu(#[from] forelock_render::gpu::GpuRenderError),
    /// The image cannot be made.
    #[error("the picture cannot be made: {0}")]
    Image(#[from] ImageError),
    /// The cache cannot be read back.
    #[error(transparent)]
    Read(#[from] forelock_io::ReadError),
    /// The picture cannot be written.
    #[error(transparent)]
    Write(#[from] forelock_io::WriteError),
    /// The cache does not have the frame.
    #[error("{}: there is no frame {frame}: the cache has {frames}, counted from 0", .path.display())]
    NoFrame {
        /// The cache.
        path: PathBuf,
        /// The frame asked for.
        frame: usize,
        /// Frames that it has.
        frames: usize,
    },
    /// The cache does not have the time.
    #[error("no frame at {time} s: the cache has frames from {first} to {last} s")]
    NoTime {
        /// The time asked for, seconds.
        time: f64,
        /// That of the first frame, seconds.
        first: f64,
        /// That of the last one, seconds.
        last: f64,
    },
    /// The name of a picture has an unknown ending.
    #[error("{}: a picture is a .png or .jpg file", .0.display())]
    Format(PathBuf),
}

/// A camera before a scene.
pub struct Studio<'a> {
    scene: &'a Scene,
    assets: &'a Assets,
    camera: Camera,
    painter: Option<&'a GpuPainter>,
}

impl<'a> Studio<'a> {
    /// The camera that `scene` asks for, before `assets` and all that the body's motion does to
    /// their place.
    pub fn new(scene: &'a Scene, assets: &'a Assets) -> Self {
        let camera = Self::camera_of(&scene.camera, scene, assets);
        Self { scene, assets, camera, painter: None }
    }

    fn camera_of(section: &CameraSection, scene: &Scene, assets: &Assets) -> Camera {
        let points =
            assets.groom.positions().iter().chain(assets.body_mesh().into_iter().flat_map(|m| &m.positions));
        let bounds = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
        let bounds = if section.follow { bounds } else { wherever_it_moves(bounds, scene, assets) };
        let angles = [section.yaw_degrees, section.pitch_degrees].map(|degrees| degrees.to_radians() as f32);
        let mut camera = Camera::framing(bounds, angles[0], angles[1]);
        camera.eye = camera.target + (camera.eye - camera.target) * section.distance as f32;
        if let Some(point) = section.look_at {
            let shift = DVec3::from_array(point).as_vec3() - camera.target;
            (camera.eye, camera.target) = (camera.eye + shift, camera.target + shift);
        }
        camera
    }

    /// The same with pictures drawn by `painter`; none: the CPU draws.
    #[must_use]
    pub fn drawn_by(self, painter: Option<&'a GpuPainter>) -> Self {
        Self { painter, ..self }
    }

    /// Where the camera is.
    pub(crate) fn camera(&self) -> Camera {
        self.camera
    }

    /// The keys of a scene whose camera is where `camera` is while the body is at rest.
    pub(crate) fn keys_of(&self, camera: &Camera) -> CameraSection {
        let back = (camera.eye - camera.target).as_dvec3();
        let yaw_degrees = back.x.atan2(back.z).to_degrees();
        let pitch_degrees = back.y.atan2(back.x.hypot(back.z)).to_degrees().clamp(-89.0, 89.0);
        let follow = self.scene.camera.follow;
        let filling = CameraSection { yaw_degrees, pitch_degrees, follow, ..CameraSection::default() };
        let filling = Self::camera_of(&filling, self.scene, self.assets);
        let distance = back.length() / f64::from(filling.eye.distance(filling.target)).max(1e-9);
        let look_at = Some(camera.target.as_dvec3().to_array());
        CameraSection { yaw_degrees, pitch_degrees, distance: distance.clamp(0.01, 100.0), look_at, follow }
    }

    /// The same with the camera at another place.
    pub(crate) fn at(self, camera: Camera) -> Self {
        Self { camera, ..self }
    }

    /// The camera at `time_secs`: where the body has gone, if it follows.
    fn camera_at(&self, time_secs: f64) -> Camera {
        if !self.scene.camera.follow {
            return self.camera;
        }
        let target = self.camera.target.as_dvec3();
        let shift = (self.assets.head_pose(time_secs).transform_point(target) - target).as_vec3();
        Camera { eye: self.camera.eye + shift, target: self.camera.target + shift, ..self.camera }
    }

    /// The same camera walked around to `yaw_degrees`.
    #[must_use]
    pub fn from_side(&self, yaw_degrees: f64) -> Self {
        let turn =
            glam::Quat::from_rotation_y((yaw_degrees - self.scene.camera.yaw_degrees).to_radians() as f32);
        let camera =
            Camera { eye: self.camera.target + turn * (self.camera.eye - self.camera.target), ..self.camera };
        Self { camera, ..*self }
    }

    /// The strands at `positions` (metres, world space) with the body where it is at `time_secs`,
    /// in a picture of `scale` times the size that the scene asks for.
    ///
    /// # Errors
    /// [`PictureError`] if there is no such picture.
    pub fn picture(&self, positions: &[Vec3], time_secs: f64, scale: f64) -> Result<Image, PictureError> {
        let section = &self.scene.hair;
        let strands = strands(section, &self.assets.groom, positions);
        let head = self.assets.head_pose(time_secs);
        let body = self.assets.body_mesh_at(time_secs);
        let dress = |mesh| dressed(section, self.assets, self.assets.cover(), Body::new(mesh, head));
        let body = body.as_deref().map(dress);
        let solids = self.assets.solid_meshes(time_secs);
        let solids = solids.iter().map(|&(mesh, pose): &(_, Pose)| Body::new(mesh, pose));
        let bodies = body.into_iter().chain(solids).collect();
        let output = &self.scene.output;
        let side = |pixels: u32| ((f64::from(pixels) * scale) as u32).max(1);
        let settings = Settings {
            width: side(output.width),
            height: side(output.height),
            width_scale: (section.width > 0.0).then_some(1.0),
            ..Settings::default()
        };
        let shown = forelock_render::Scene::new(bodies, vec![strands], self.camera_at(time_secs));
        match self.painter {
            Some(painter) => painter.render(&shown, &settings),
            None => Ok(forelock_render::render(&shown, &settings)?),
        }
    }

    /// Frame `frame` of `cache`, read from `path`, at `scale` times the size that the scene asks
    /// for.
    ///
    /// # Errors
    /// [`PictureError`] if there is no such frame or picture.
    pub fn frame(
        &self,
        cache: &mut Cache,
        path: &Path,
        frame: usize,
        scale: f64,
    ) -> Result<Image, PictureError> {
        if frame >= cache.frames() {
            return Err(PictureError::NoFrame { path: path.to_path_buf(), frame, frames: cache.frames() });
        }
        let mut positions = Vec::new();
        cache.read_frame(frame, &mut positions)?;
        self.picture(&positions, self.time_secs(cache, frame), scale)
    }

    /// Several frames at once.
    fn frames(&self, cache: &mut Cache, frames: &[usize], scale: f64) -> Result<Vec<Image>, PictureError> {
        let mut moments = Vec::with_capacity(frames.len());
        for &frame in frames {
            let mut positions = Vec::new();
            cache.read_frame(frame, &mut positions)?;
            moments.push((positions, self.time_secs(cache, frame)));
        }
        let picture = |(positions, time): &(Vec<Vec3>, f64)| self.picture(positions, *time, scale);
        if self.painter.is_some() {
            // A GPU draws one picture at a time.
            return moments.iter().map(picture).collect();
        }
        moments.par_iter().map(picture).collect()
    }

    fn time_secs(&self, cache: &Cache, frame: usize) -> f64 {
        frame_time_secs(self.scene, cache, frame)
    }

    /// Frames of `cache`, `output.film_every` frames of the run apart or as near to that as it has
    /// them, as an animated PNG of half the size of a picture.
    ///
    /// # Errors
    /// [`PictureError`] if a frame cannot be read or drawn.
    pub fn film(&self, cache: &mut Cache, observer: &mut Observer<'_>) -> Result<Vec<u8>, PictureError> {
        let output = &self.scene.output;
        let apart = f64::from(output.film_every) / f64::from(output.cache_every);
        let step = apart.round().max(1.0) as usize;
        let frames: Vec<usize> = (0..cache.frames()).step_by(step).collect();
        let every = step as f64 * f64::from(output.cache_every);
        let fps = (self.scene.time.fps / every).round().clamp(1.0, 1000.0) as u32;
        observer(&Progress::Begin { what: "filming", done: 0, total: frames.len() as u64 });
        let mut film = None;
        // As many frames at a time as there are threads: parts of a picture are drawn by one.
        for batch in frames.chunks(rayon::current_num_threads().max(1)) {
            for image in self.frames(cache, batch, 0.5)? {
                if film.is_none() {
                    film = Some(Film::new(Cursor::new(Vec::new()), image.width(), image.height(), fps)?);
                }
                if let Some(film) = &mut film {
                    film.push(&image)?;
                }
                observer(&Progress::Step);
            }
        }
        observer(&Progress::End);
        let bytes = film.map(Film::finish).transpose()?;
        Ok(bytes.map(Cursor::into_inner).unwrap_or_default())
    }

    /// A sheet of frames of `cache` at equal times, from the first to the last.
    ///
    /// # Errors
    /// [`PictureError`] if a frame cannot be read or drawn.
    pub fn sheet(&self, cache: &mut Cache) -> Result<Image, PictureError> {
        let count = SHEET.0.min(cache.frames()).max(1);
        let last = cache.frames().saturating_sub(1);
        let frames: Vec<usize> = (0..count).map(|index| index * last / (count - 1).max(1)).collect();
        let labels = frames.iter().map(|&frame| format!("{:.2} S", self.time_secs(cache, frame)));
        let labels: Vec<String> = labels.collect();
        let pictures: Vec<_> = self.frames(cache, &frames, 0.4)?.into_iter().zip(labels).collect();
        labelled(&pictures, SHEET.1)
    }

    /// The frames of `cache` that are nearest to `times` (seconds), in rows of at most three, each
    /// of the size that the scene asks for.
    ///
    /// # Errors
    /// [`PictureError`] if a frame cannot be read or drawn, or there is no time.
    pub fn strip(&self, cache: &mut Cache, times: &[f64]) -> Result<Image, PictureError> {
        let stored: Vec<f64> = (0..cache.frames()).map(|frame| self.time_secs(cache, frame)).collect();
        let [first, last] = [stored.first(), stored.last()].map(|secs| secs.copied().unwrap_or(0.0));
        // Half a frame: times are often written with few digits.
        let slack = stored.get(1).map_or(0.0, |second| 0.5 * (second - first)) + 1e-9;
        let nearest = |&time: &f64| {
            if !(time >= first - slack && time <= last + slack) {
                return Err(PictureError::NoTime { time, first, last });
            }
            let distance = |frame: &usize| (stored[*frame] - time).abs();
            Ok((0..stored.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0))
        };
        let frames: Vec<usize> = times.iter().map(nearest).collect::<Result<_, _>>()?;
        let pictures = self.frames(cache, &frames, 1.0)?;
        let [width, height] = pictures.first().map_or([0; 2], |first| [first.width(), first.height()]);
        let count = pictures.len() as u32;
        let columns = if count == 4 { 2 } else { count.min(3) };
        let size = [width.saturating_mul(columns), height.saturating_mul(count.div_ceil(columns.max(1)))];
        let mut strip = Image::filled(size[0], size[1], [0, 0, 0, 255])?;
        for (place, picture) in (0..).zip(&pictures) {
            strip.paste(picture, place % columns * width, place / columns * height);
        }
        Ok(strip)
    }

    /// A sheet of the rest shape from four sides.
    ///
    /// # Errors
    /// [`PictureError`] if it cannot be drawn.
    pub fn sides(&self) -> Result<Image, PictureError> {
        let mut pictures = Vec::new();
        for (name, yaw) in [("FRONT", 0.0), ("THREE QUARTERS", 40.0), ("SIDE", 90.0), ("BACK", 180.0)] {
            pictures.push((
                self.from_side(yaw).picture(self.assets.groom.positions(), 0.0, 0.6)?,
                name.to_owned(),
            ));
        }
        labelled(&pictures, 4)
    }
}

/// The time of frame `frame` of `cache`, that of a run of `scene`.
pub(crate) fn frame_time_secs(scene: &Scene, cache: &Cache, frame: usize) -> f64 {
    let time = cache.times_secs().and_then(|times| times.get(frame).copied());
    time.unwrap_or(frame as f64 * f64::from(scene.output.cache_every) / scene.time.fps)
}

/// `positions` of the strands of `groom` (metres, world space) as `section` shows them.
pub(crate) fn strands<'a>(section: &HairSection, groom: &'a Groom, positions: &'a [Vec3]) -> Strands<'a> {
    let width = section.width as f32;
    Strands {
        widths: groom.widths.as_deref().filter(|_| width == 0.0),
        colours: groom.colours.as_deref(),
        width: if width > 0.0 { width } else { HAIR_WIDTH },
        ..Strands::new(positions, groom.strand_offsets(), section.hair_colour())
    }
}

/// `body`, that of `assets`, in the colours of `section`, where hair covers it as `cover` says.
pub(crate) fn dressed<'a>(
    section: &HairSection,
    assets: &Assets,
    cover: Option<&'a Cover>,
    body: Body<'a>,
) -> Body<'a> {
    let hide = HairColour::by_name(&section.body_colour).map(|hair| hair.albedo());
    let hair = cover.and_then(|cover| cover.colour).unwrap_or_else(|| section.hair_colour().albedo());
    let shade = SCALP * hair + (1.0 - SCALP) * Body::CLAY;
    Body {
        colour: hide.unwrap_or(Body::CLAY),
        face: assets.face().map(|rest| Face { rest, brows: hair }),
        // A hide has the colour of hair everywhere.
        scalp: cover.filter(|_| hide.is_none()).map(|cover| Scalp { shares: &cover.shares, colour: shade }),
        ..body
    }
}

/// The box `bounds`, grown so that it holds itself wherever its middle is in the scene's time.
fn wherever_it_moves(bounds: (Vec3, Vec3), scene: &Scene, assets: &Assets) -> (Vec3, Vec3) {
    let (lo, hi) = bounds;
    let middle = ((lo + hi) * 0.5).as_dvec3();
    let shift = |moment: u32| {
        let time = f64::from(moment) / f64::from(MOMENTS) * f64::from(scene.time.frames) / scene.time.fps;
        (assets.head_pose(time).transform_point(middle) - middle).as_vec3()
    };
    let shifts = (0..=MOMENTS).map(shift).filter(|shift| shift.is_finite());
    let (least, most) = shifts.fold((Vec3::ZERO, Vec3::ZERO), |(a, b), s| (a.min(s), b.max(s)));
    (lo + least, hi + most)
}

/// Pictures of equal size with their labels as one sheet of `columns`.
///
/// # Errors
/// [`PictureError`] if there is no picture or their sizes differ.
pub fn labelled(pictures: &[(Image, String)], columns: u32) -> Result<Image, PictureError> {
    let cells: Vec<Labelled<'_>> = pictures.iter().map(|(image, label)| Labelled { image, label }).collect();
    Ok(contact_sheet(&cells, columns)?)
}

/// Writes `image` to the file `path`, whole or not at all: as a JPEG if the name ends in `.jpg` or
/// `.jpeg`, as a PNG if it ends in `.png` or has no ending.
///
/// # Errors
/// [`PictureError`] if the name ends otherwise or the file cannot be written.
pub fn write_picture(path: &Path, image: &Image) -> Result<(), PictureError> {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    let bytes = match ending.as_deref() {
        None | Some("png") => image.to_png()?,
        Some("jpg" | "jpeg") => image.to_jpeg()?,
        Some(_) => return Err(PictureError::Format(path.to_owned())),
    };
    Ok(forelock_io::atomic_write(path, |file| file.write_all(&bytes))?)
}

/// What pictures a run left.
#[derive(Clone, Debug, Default)]
pub(crate) struct RunPictures {
    pub(crate) files: Vec<PathBuf>,
    pub(crate) shown: crate::report::Pictures,
}

/// The end of a run.
pub(crate) struct LastFrame<'a> {
    /// Its strands, metres.
    pub(crate) positions: &'a [Vec3],
    pub(crate) time_secs: f64,
    /// The cache, if there is one and it is complete.
    pub(crate) cache: Option<&'a Path>,
}

/// Makes the pictures of a run that its scene asks for, into the folder `out`.
///
/// # Errors
/// [`PictureError`] if one cannot be made.
pub(crate) fn of_run(
    studio: &Studio<'_>,
    last: &LastFrame<'_>,
    out: &Path,
    observer: &mut Observer<'_>,
) -> Result<RunPictures, PictureError> {
    let output = &studio.scene.output;
    let mut made = RunPictures::default();
    let mut write = |name: &str, bytes: &[u8]| {
        let path = out.join(name);
        forelock_io::atomic_write(&path, |file| file.write_all(bytes)).map(|()| made.files.push(path))
    };
    if output.picture {
        let png = studio.picture(last.positions, last.time_secs, 1.0)?.to_png()?;
        write("picture.png", &png)?;
        made.shown.picture = Some(png);
    }
    let Some(path) = last.cache.filter(|_| output.film || output.contact_sheet) else {
        return Ok(made);
    };
    let mut cache = Cache::open(path)?;
    if output.contact_sheet {
        write("contact-sheet.png", &studio.sheet(&mut cache)?.to_png()?)?;
        made.shown.contact_sheet = Some("contact-sheet.png".to_owned());
    }
    if output.film {
        write("film.png", &studio.film(&mut cache, observer)?)?;
        made.shown.film = Some("film.png".to_owned());
    }
    Ok(made)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Override;
    use forelock_core::groom::Groom;

    /// Share of pixels that a jump of the body changes, seen by a camera with `keys`.
    fn changed(keys: &[&str]) -> f64 {
        let jump = ["body.motion=\"builtin:jump\"", "output.width=64", "output.height=64"];
        let sets: Vec<Override> = jump.iter().chain(keys).map(|key| Override::set(key).unwrap()).collect();
        let scene = Scene::builtin(&sets).unwrap();
        let strand = [Vec3::Y * 0.12, Vec3::Y * 0.2];
        let assets = Assets::around(&scene, Groom::from_strands([strand]).unwrap()).unwrap();
        let studio = Studio::new(&scene, &assets);
        let pictures = [0.0, 0.4].map(|time| {
            let head = assets.head_pose(time);
            let moved = strand.map(|p| head.transform_point(p.as_dvec3()).as_vec3());
            studio.picture(&moved, time, 1.0).unwrap()
        });
        let [a, b] = pictures.each_ref().map(|picture| picture.rgba().chunks_exact(4));
        let far = |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 16);
        a.zip(b).filter(far).count() as f64 / (64.0 * 64.0)
    }

    #[test]
    fn the_keys_of_a_camera_put_it_where_it_is() {
        let scene = Scene::builtin(&[]).unwrap();
        let strand = [Vec3::Y * 0.12, Vec3::Y * 0.2];
        let assets = Assets::around(&scene, Groom::from_strands([strand]).unwrap()).unwrap();
        let studio = Studio::new(&scene, &assets);
        for eye in [Vec3::new(0.1, 0.4, -0.9), Vec3::new(-0.3, -0.2, 0.02)] {
            let camera = Camera { eye, target: Vec3::new(0.02, 0.1, 0.05), ..studio.camera() };
            let moved = Scene { camera: studio.keys_of(&camera), ..scene.clone() };
            let found = Studio::new(&moved, &assets).camera();
            assert!(
                found.eye.distance(eye) < 1e-5 && found.target.distance(camera.target) < 1e-6,
                "{found:?}"
            );
        }
    }

    #[test]
    fn a_camera_that_follows_sees_the_body_stand_still() {
        assert!(changed(&[]) > 0.05, "the head jumps out of its place");
        assert!(changed(&["camera.follow=true"]) < 0.01);
        assert!(changed(&["camera.follow=true", "camera.look_at=[0.0, 0.1, 0.0]"]) < 0.01);
    }
}
