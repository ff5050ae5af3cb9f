//! The window on a display without a screen, Xvfb, and a software Vulkan.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A display, until it is dropped.
struct Display {
    server: Child,
    name: String,
}

impl Display {
    /// Starts one; none if there is no Xvfb, unless `FORELOCK_REQUIRE_DISPLAY` is set.
    fn start() -> Option<Self> {
        let name = format!(":{}", 100 + std::process::id() % 800);
        let size = ["-screen", "0", "1000x700x24", "-nolisten", "tcp"];
        let server = Command::new("Xvfb").arg(&name).args(size).stderr(Stdio::null()).spawn();
        let is_required = std::env::var_os("FORELOCK_REQUIRE_DISPLAY").is_some();
        match server {
            Ok(server) => Some(Self { server, name }),
            Err(error) => {
                assert!(!is_required, "Xvfb cannot be started: {error}");
                None
            }
        }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// The example `window`, which cargo builds with all tests of the workspace.
fn program() -> PathBuf {
    let own = std::env::current_exe().unwrap();
    let program = own.parent().and_then(Path::parent).unwrap().join("examples/window");
    assert!(program.is_file(), "{}: build all tests, or `--example window`", program.display());
    program
}

/// Size and pixels of a picture: RGB, whatever follows.
fn read(path: &Path) -> ([usize; 2], Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!(info.bit_depth, png::BitDepth::Eight);
    ([info.width as usize, info.height as usize], pixels)
}

/// The share of a picture's middle that is redder than backdrop, skin and scalp: red hair.
fn hair_in([width, height]: [usize; 2], pixels: &[u8]) -> f64 {
    let channels = pixels.len() / (width * height);
    let rows = pixels.chunks_exact(channels * width).skip(height / 6).take(height / 2);
    let pixels = rows.flat_map(|row| row.chunks_exact(channels).skip(width / 5).take(width / 2));
    let hair = pixels.filter(|p| p[0] > 25 && f32::from(p[0]) > 1.8 * f32::from(p[2])).count();
    hair as f64 / (width / 2 * (height / 2)) as f64
}

#[test]
fn the_window_opens_and_shows_hair() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("window.png");
    let started = Instant::now();
    let mut output = None;
    // The server needs a moment.
    while started.elapsed() < Duration::from_secs(20) {
        let command = Command::new(program())
            .arg(&picture)
            .args(["4", "hair.colour=red"])
            .env("DISPLAY", &display.name)
            .env("XDG_RUNTIME_DIR", folder.path())
            .env_remove("WAYLAND_DISPLAY")
            .output()
            .unwrap();
        let is_early = String::from_utf8_lossy(&command.stderr).contains("no display");
        output = Some(command);
        if !is_early {
            break;
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    let output = output.unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let (size, pixels) = read(&picture);
    assert!(size[0] >= 640 && size[1] >= 400, "{size:?}");
    let share = hair_in(size, &pixels);
    assert!(share > 0.05, "hair in {:.2} % of the middle of the window", 100.0 * share);
}

#[test]
fn without_a_display_there_is_one_error() {
    let output = Command::new(program())
        .arg("window.png")
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(errors.contains("display") && errors.contains("forelock render"), "{errors}");
    assert!(!errors.contains("panicked"), "{errors}");
}
