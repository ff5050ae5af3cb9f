//! Random input: the window neither panics nor grows.
//!
//! ```sh
//! FORELOCK_RANDOM_INPUT_SECS=1800 \
//!     cargo test --release --workspace --test random_input -- --nocapture
//! ```
//!
//! runs for half an hour; the default is a quarter of a minute. A program of its own, because it
//! works in a folder of its own and counts all bytes of its heap.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use eframe::egui;
use egui::{Event, Key, Modifiers, PointerButton, Vec2};
use forelock::scene::Override;
use forelock::session::Phase;
use forelock::{Backend, Scene};
use forelock_view::App;

const SIZE: Vec2 = Vec2::new(1000.0, 700.0);
const KEYS: [Key; 14] = [
    Key::Space,
    Key::ArrowRight,
    Key::ArrowLeft,
    Key::ArrowDown,
    Key::Home,
    Key::F,
    Key::Num1,
    Key::Num3,
    Key::Num7,
    Key::Z,
    Key::Y,
    Key::Tab,
    Key::Enter,
    Key::Escape,
];

/// A generator of numbers: xorshift (Marsaglia 2003).
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % end
    }

    fn share(&mut self) -> f32 {
        self.below(1 << 20) as f32 / (1 << 20) as f32
    }
}

/// The allocator of the system; it counts the bytes that are allocated.
struct Counting;

static BYTES: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        BYTES.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        BYTES.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn memory() -> usize {
    BYTES.load(Ordering::Relaxed)
}

fn event(random: &mut Random, at: &mut egui::Pos2) -> Event {
    let modifiers = match random.below(6) {
        0 => Modifiers::SHIFT,
        1 => Modifiers::COMMAND,
        _ => Modifiers::NONE,
    };
    match random.below(12) {
        0..=4 => {
            // Near the last place, so that drags are drags; sometimes anywhere.
            let anywhere = egui::pos2(random.share() * SIZE.x, random.share() * SIZE.y);
            *at = if random.below(3) == 0 { anywhere } else { *at + (anywhere - *at) * 0.05 };
            Event::PointerMoved(*at)
        }
        5..=8 => {
            let button = match random.below(8) {
                0 => PointerButton::Secondary,
                1 => PointerButton::Middle,
                _ => PointerButton::Primary,
            };
            Event::PointerButton { pos: *at, button, pressed: random.below(2) == 0, modifiers }
        }
        9 => Event::MouseWheel {
            unit: egui::MouseWheelUnit::Point,
            delta: Vec2::new(0.0, 200.0 * (random.share() - 0.5)),
            phase: egui::TouchPhase::Move,
            modifiers,
        },
        10 => {
            let key = KEYS[random.below(KEYS.len() as u64) as usize];
            Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers }
        }
        _ => Event::Text(["1", "-", "e9", "0.1", "nan", " "][random.below(6) as usize].to_owned()),
    }
}

/// Memory after the scene of `file` has been opened in place of what is open, and all that was open
/// has ended: the least of some seconds.
fn with_scene_anew(ctx: &egui::Context, app: &mut App, file: &std::path::Path) -> usize {
    app.open(ctx, file);
    let started = Instant::now();
    let mut least = usize::MAX;
    while app.is_loading() || started.elapsed() < Duration::from_secs(5) {
        assert!(started.elapsed() < Duration::from_secs(120), "{:?}", app.message());
        drop(ctx.run_ui(egui::RawInput::default(), |ui| app.show(ui)));
        std::thread::sleep(Duration::from_millis(5));
        if !app.is_loading() {
            least = least.min(memory());
        }
    }
    least
}

#[test]
fn random_input_neither_panics_nor_takes_memory() {
    let secs = std::env::var("FORELOCK_RANDOM_INPUT_SECS").ok().and_then(|secs| secs.parse().ok());
    let lasts = Duration::from_secs(secs.unwrap_or(15));
    let folder = tempfile::tempdir().unwrap();
    std::env::set_current_dir(folder.path()).unwrap();
    let keys = ["groom.strands=60", "body.sdf_cells=32", "time.frames=4", "output.film=false"];
    let small = ["output.width=64", "output.height=64"];
    let sets: Vec<Override> = keys.iter().chain(&small).map(|key| Override::set(key).unwrap()).collect();
    let scene = Scene::builtin(&sets).unwrap();
    let file = folder.path().join("start.toml");
    std::fs::write(&file, scene.to_toml()).unwrap();
    let ctx = egui::Context::default();
    let mut app = App::on_cpu(&ctx, scene, Backend::Cpu);

    let mut random = Random(2026);
    let mut at = egui::pos2(500.0, 350.0);
    let started = Instant::now();
    let (mut events, mut opened, mut told) = (0, Vec::new(), 0_u64);
    while started.elapsed() < lasts {
        let new: Vec<Event> = (0..random.below(4)).map(|_| event(&mut random, &mut at)).collect();
        events += new.len();
        let input = egui::RawInput {
            screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, SIZE)),
            time: Some(started.elapsed().as_secs_f64()),
            events: new,
            ..Default::default()
        };
        // What is to be drawn is not drawn: textures would pile up in a harness without a renderer.
        drop(ctx.run_ui(input, |ui| app.show(ui)));
        if random.below(40) == 0 {
            std::thread::sleep(Duration::from_millis(20));
        }
        assert_ne!(app.session().status().phase, Phase::Failed, "{:?}", app.message());
        let message = app.message().unwrap_or_default();
        assert!(!message.contains("error of the program"), "{message}");
        let minute = started.elapsed().as_secs() / 60;
        if minute > told {
            told = minute;
            let before = memory();
            // Edits make more strands, so memory is compared with the same scene open.
            let after = with_scene_anew(&ctx, &mut app, &file);
            opened.push(after);
            let [now, open] = [before, after].map(|bytes| bytes as f64 * 1e-6);
            println!(
                "minute {minute}: {events} events, {now:.1} MB, {open:.1} MB with the scene opened anew"
            );
        }
    }
    println!("{events} events, {} pictures, frame {}", app.pictures(), app.frame());
    assert!(app.pictures() > 0);
    // A long step of a session that was open may still hold its memory: the least of each half
    // counts.
    let (early, late) = opened.split_at(opened.len() / 2);
    if let (Some(early), Some(late), true) = (early.iter().min(), late.iter().min(), opened.len() >= 10) {
        let grown = *late as f64 / *early as f64 - 1.0;
        assert!(grown < 0.02, "memory grew by {:.1} %", 100.0 * grown);
    }
}
