//! Random input: the window neither panics nor grows.
//!
//! `FORELOCK_RANDOM_INPUT_SECS=1800 cargo test --release -p forelock-view --test random_input`
//! runs for half an hour; the default is a quarter of a minute. A program of its own, because it
//! works in a folder of its own.

use std::time::{Duration, Instant};

use eframe::egui;
use egui::{Event, Key, Modifiers, PointerButton, Vec2};
use egui_kittest::Harness;
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

/// Resident memory, bytes; 0 where it is not known.
fn memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse().ok());
    1024 * kilobytes.unwrap_or(0_u64)
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
    let app = App::on_cpu(&egui::Context::default(), scene, Backend::Cpu);
    let show = |ui: &mut egui::Ui, app: &mut App| app.show(ui);
    let mut harness = Harness::builder().with_size(SIZE).build_ui_state(show, app);

    let mut random = Random(2026);
    let mut at = egui::pos2(500.0, 350.0);
    let started = Instant::now();
    let (mut events, mut first, mut told) = (0_u64, None, 0_u64);
    while started.elapsed() < lasts {
        for _ in 0..random.below(4) {
            harness.event(event(&mut random, &mut at));
            events += 1;
        }
        harness.step();
        if random.below(40) == 0 {
            std::thread::sleep(Duration::from_millis(20));
        }
        let app = harness.state();
        assert_ne!(app.session().status().phase, Phase::Failed, "{:?}", app.message());
        let message = app.message().unwrap_or_default();
        assert!(!message.contains("error of the program"), "{message}");
        let minute = started.elapsed().as_secs() / 60;
        if minute > told {
            told = minute;
            first.get_or_insert_with(memory);
            println!("minute {minute}: {events} events, {} MB", memory() / 1_000_000);
        }
    }
    println!("{events} events, frame {}", harness.state().frame());
    if let Some(first) = first.filter(|_| lasts > Duration::from_secs(300)) {
        let grown = memory() as f64 / first as f64 - 1.0;
        assert!(grown < 0.02, "memory grew by {:.1} %", 100.0 * grown);
    }
}
