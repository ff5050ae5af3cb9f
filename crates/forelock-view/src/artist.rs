//! Pictures of the hair, drawn on a thread of their own, so that neither window nor simulation wait
//! for them.
//!
//! # Practice
//! The window asks for a picture in every repaint; the newest request counts. On a graphics card
//! the renderer draws into a texture of the window's device. Without one, or with a driver that
//! runs on the CPU, the CPU draws, unless a device is asked for. While the picture changes it has
//! as many pixels as can be drawn in time; when it stands still it is drawn once more in full. On
//! the CPU half of the processors draw, and the simulation has the others.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use crate::ghost::rest_shape;
use crate::lattice::edges_of;
use crate::lines::Lines;
use crate::measure::Measure;
use eframe::egui;
use forelock::player::Moment;
use forelock::scene::HairSection;
use forelock_render::gpu::{GpuRenderError, GpuRenderer};
use forelock_render::{Camera, Settings};

/// Milliseconds that a picture of something in motion may take.
const AIM_MS: f32 = 60.0;
/// The smallest scale of a picture.
const COARSEST: f32 = 0.25;
/// Pixels that a strand of a picture in motion is wide at least.
const COARSE_STRANDS: f32 = 0.3;
/// The format of textures that the window shows.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// What is to be drawn.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// The hair.
    pub moment: Arc<Moment>,
    /// The camera.
    pub camera: Camera,
    /// Pixels in x and y.
    pub size: [u32; 2],
    /// The colours.
    pub hair: HairSection,
    /// What the colours of strands show, and a frame before this one, for speeds.
    pub measure: Measure,
    /// See `measure`.
    pub previous: Option<Arc<Moment>>,
    /// Whether the rest shape is drawn too.
    pub has_ghost: bool,
    /// Whether the grid is drawn too, if the hair has one.
    pub has_grid: bool,
    /// Whether the next frame comes soon: then not all pixels are drawn, if that takes long.
    pub moves: bool,
}

impl Wanted {
    /// Whether its picture is that of `other` too.
    fn shows_the_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.moment, &other.moment)
            && (self.camera, self.size, &self.hair) == (other.camera, other.size, &other.hair)
            && (self.measure, self.has_ghost, self.has_grid, self.moves)
                == (other.measure, other.has_ghost, other.has_grid, other.moves)
    }
}

/// A finished picture.
#[derive(Debug)]
pub struct Drawn {
    /// Its pixels.
    pub picture: Picture,
    /// Milliseconds that it took.
    pub ms: f32,
    /// Whether it has as many pixels as were wanted.
    pub is_whole: bool,
    /// What is to be known: strands that are missing in the picture.
    pub note: Option<String>,
}

/// The pixels of a picture.
#[derive(Debug)]
pub enum Picture {
    /// By the CPU.
    Image(egui::ColorImage),
    /// On the device of the window.
    Texture(wgpu::TextureView),
}

/// The thread that draws. Dropping it ends the thread.
pub struct Artist {
    requests: Option<Sender<Wanted>>,
    drawn: Arc<Mutex<Option<Result<Drawn, String>>>>,
    thread: Option<JoinHandle<()>>,
    /// What was asked for last.
    last: Option<Wanted>,
    busy: Arc<AtomicBool>,
    /// What draws: "CPU", or the name of a GPU.
    pub device: String,
}

impl Artist {
    /// Starts the thread: on `gpu`, a device with its name, or on the CPU. `wake` is called when a
    /// picture is ready. `busy` is set while it draws.
    pub fn start(
        gpu: Option<(wgpu::Device, wgpu::Queue, String)>,
        busy: Arc<AtomicBool>,
        wake: impl Fn() + Send + 'static,
    ) -> Self {
        let (requests, received) = channel();
        let drawn = Arc::default();
        let device = gpu.as_ref().map_or_else(|| "CPU".to_owned(), |(_, _, name)| name.clone());
        let shared = Arc::clone(&drawn);
        let of_thread = busy.clone();
        let wake = move || {
            of_thread.store(false, Ordering::Release);
            wake();
        };
        let draw = move || {
            let easel = gpu.map(|(device, queue, _)| Easel::new(device, queue));
            Hand { easel, threads: threads(), scale: 0.5 }.draw_all(&received, &shared, &wake);
        };
        let thread = std::thread::Builder::new().name("artist".to_owned()).spawn(draw);
        let thread = match thread {
            Ok(thread) => Some(thread),
            Err(error) => {
                let message = format!("the drawing thread cannot start: {error}");
                *lock(&drawn) = Some(Err(message));
                None
            }
        };
        Self { requests: Some(requests), drawn, thread, last: None, busy, device }
    }

    /// Asks for a picture, unless it is the one that was asked for last.
    pub fn want(&mut self, wanted: Wanted) {
        if self.last.as_ref().is_some_and(|last| wanted.shows_the_same(last)) {
            return;
        }
        self.last = Some(wanted.clone());
        if let Some(requests) = &self.requests {
            // Before the thread can clear it.
            self.busy.store(true, Ordering::Release);
            if requests.send(wanted).is_err() {
                // The thread has ended, which it does only if it could not start.
                self.busy.store(false, Ordering::Release);
            }
        }
    }

    /// The newest picture that has not been taken, or why there is none.
    pub fn take(&self) -> Option<Result<Drawn, String>> {
        lock(&self.drawn).take()
    }
}

impl Drop for Artist {
    fn drop(&mut self) {
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been printed.
            let _ = thread.join();
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Half of the processors, in a pool apart from that of the simulation: in one pool a step would
/// wait for the tiles of a picture.
fn threads() -> Option<rayon::ThreadPool> {
    let all = std::thread::available_parallelism().map_or(1, usize::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(all.div_ceil(2));
    pool.thread_name(|_| "artist".to_owned()).build().ok()
}

/// What the thread draws with.
struct Hand {
    easel: Option<Easel>,
    /// The threads of what the CPU does for pictures.
    threads: Option<rayon::ThreadPool>,
    /// Scale of the pictures of what moves.
    scale: f32,
}

impl Hand {
    fn draw_all(
        &mut self,
        requests: &Receiver<Wanted>,
        drawn: &Mutex<Option<Result<Drawn, String>>>,
        wake: &dyn Fn(),
    ) {
        // What stands still and is not drawn in full.
        let mut coarse: Option<Wanted> = None;
        loop {
            let next = match coarse.take() {
                None => requests.recv().map(|next| (next, false)).map_err(|_| TryRecvError::Disconnected),
                Some(wanted) => match requests.try_recv() {
                    Err(TryRecvError::Empty) => Ok((wanted, true)),
                    next => next.map(|next| (next, false)),
                },
            };
            let Ok(mut next) = next else { return };
            if let Some(newer) = requests.try_iter().last() {
                next = (newer, false);
            }
            let (wanted, in_full) = next;
            let done = catch_unwind(AssertUnwindSafe(|| self.draw(&wanted, in_full)));
            let done = done
                .unwrap_or_else(|_| Err("an error of the program in a picture; please report it".to_owned()));
            if done.as_ref().is_ok_and(|drawn| !drawn.is_whole) && !wanted.moves {
                coarse = Some(wanted);
            }
            *lock(drawn) = Some(done);
            wake();
        }
    }

    fn draw(&mut self, wanted: &Wanted, in_full: bool) -> Result<Drawn, String> {
        let started = Instant::now();
        let scale = if in_full { 1.0 } else { self.scale };
        let size = wanted.size.map(|side| ((side as f32 * scale) as u32).clamp(1, 4096));
        let width = wanted.hair.width > 0.0;
        let settings = Settings {
            width: size[0],
            height: size[1],
            samples: if scale < 1.0 { 1 } else { 2 },
            width_scale: width.then_some(1.0),
            // What has few pixels gets few strands.
            thinnest: if scale < 1.0 { COARSE_STRANDS } else { Settings::default().thinnest },
            ..Settings::default()
        };
        let colours = wanted.measure.colours(&wanted.moment, wanted.previous.as_deref());
        let mut scene = wanted.moment.picture(&wanted.hair, wanted.camera);
        if let Some(colours) = &colours {
            scene.strands.iter_mut().for_each(|strands| strands.colours = Some(colours));
        }
        let ghost = wanted.has_ghost.then(|| rest_shape(&wanted.moment));
        scene.strands.extend(ghost.as_ref().map(Lines::strands));
        let grid = wanted.moment.told.grid.as_ref().filter(|_| wanted.has_grid).map(edges_of);
        scene.strands.extend(grid.as_ref().map(Lines::strands));
        let easel = &mut self.easel;
        let mut paint = || match easel {
            Some(easel) => easel.draw(&scene, &settings).map_err(|error| error.to_string()),
            None => {
                let image = forelock_render::render(&scene, &settings).map_err(|error| error.to_string())?;
                let size = size.map(|side| side as usize);
                let image = egui::ColorImage::from_rgba_unmultiplied(size, image.rgba());
                Ok((Picture::Image(image), None))
            }
        };
        let (picture, note) = match &self.threads {
            Some(threads) => threads.install(paint),
            None => paint(),
        }?;
        let ms = started.elapsed().as_secs_f32() * 1e3;
        if !in_full {
            // Part of the time does not depend on the pixels: small steps.
            let change = (AIM_MS / ms.max(1.0)).sqrt().clamp(0.7, 1.3);
            self.scale = (self.scale * change).clamp(COARSEST, 1.0);
        }
        Ok(Drawn { picture, ms, is_whole: size == wanted.size, note })
    }
}

/// A renderer on the device of the window.
struct Easel {
    device: wgpu::Device,
    renderer: GpuRenderer,
}

impl Easel {
    fn new(device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let renderer = GpuRenderer::new(&device, &queue);
        Self { device, renderer }
    }

    fn draw(
        &mut self,
        scene: &forelock_render::Scene<'_>,
        settings: &Settings,
    ) -> Result<(Picture, Option<String>), GpuRenderError> {
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size: wgpu::Extent3d { width: settings.width, height: settings.height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        self.renderer.render_to(scene, settings, &view, FORMAT)?;
        // Pictures must not queue up on a device that is slower than the simulation.
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|error| GpuRenderError::Failed(error.to_string()))?;
        let dropped = self.renderer.report().dropped;
        let note = (dropped > 0).then(|| format!("{dropped} pieces of strands are missing in the picture"));
        Ok((Picture::Texture(view), note))
    }
}
