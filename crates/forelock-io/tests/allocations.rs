//! Damaged files take no memory for what is not there. This is a test program of its own because
//! the counter covers the whole process.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Cursor;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use forelock_core::groom::{Groom, Labels};
use forelock_io::alembic;
use forelock_io::{Usd, obj, usd};
use glam::Vec3;

struct Counting;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let live = LIVE.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        MOST.fetch_max(live, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The counter counts one test at a time.
static TURN: Mutex<()> = Mutex::new(());

/// The bytes that `read` takes at most, and what it returns.
fn counted<T>(read: impl FnOnce() -> T) -> (usize, T) {
    let before = LIVE.load(Ordering::SeqCst);
    MOST.store(before, Ordering::SeqCst);
    let read = read();
    (MOST.load(Ordering::SeqCst) - before, read)
}

/// Whether `bytes` were read as a layer of USD.
fn read_layer(bytes: &[u8]) -> bool {
    Usd::open(Cursor::new(bytes)).and_then(|layer| layer.frame(0)).is_ok()
}

#[test]
fn damaged_layers_take_little_memory() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let line = |x: f32| (0..40).map(move |i| Vec3::new(x, 0.01 * i as f32, 0.0)).collect::<Vec<_>>();
    let mut groom = Groom::from_strands((0..50).map(|s| line(s as f32))).unwrap();
    groom.widths = Some(vec![1e-4; 2000]);
    let pxr: [&[u8]; 2] = [include_bytes!("data/usd/pxr.usda"), include_bytes!("data/usd/pxr_0.8.usdc")];
    let own = [usd::write_text(&groom), usd::write_binary(&groom)];
    let mut state = 0x2545_f491_4f6c_dd1du64;
    let mut next = |most: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % most
    };
    for bytes in pxr.into_iter().chain(own.iter().map(Vec::as_slice)) {
        let (whole, is_read) = counted(|| read_layer(bytes));
        assert!(is_read);
        assert!(whole < 24 * bytes.len(), "{whole} bytes for a file of {}", bytes.len());
        let mut most = 0;
        for _ in 0..1500 {
            let mut damaged = bytes.to_vec();
            for _ in 0..=next(3) {
                // Half of the changes are in the tables, at the end.
                let within = if next(2) == 0 { damaged.len() } else { damaged.len().min(1500) };
                let at = damaged.len() - 1 - next(within);
                damaged[at] = if next(2) == 0 { next(256) as u8 } else { 0xff };
            }
            most = most.max(counted(|| read_layer(&damaged)).0);
        }
        eprintln!("{} bytes: whole {whole}, damaged at most {most}", bytes.len());
        // Compressed tables may say that they are larger than they are, within a limit.
        assert!(most < 64 * bytes.len() + (2 << 20), "{most} bytes for a file of {}", bytes.len());
    }
}

/// Reads the first and the last frame of an Alembic archive.
fn read_archive(bytes: &[u8]) {
    if let Ok(mut reader) = alembic::Reader::open(Cursor::new(bytes)) {
        let _ = (reader.read(0), reader.read(reader.frames().wrapping_sub(1)));
    }
}

#[test]
fn damaged_archives_neither_panic_nor_take_much_memory() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let strand = |x: f32| [Vec3::ZERO, Vec3::new(x, -0.1, 0.0), Vec3::new(x, -0.2, 0.0)];
    let mut groom = Groom::from_strands((0..20).map(|s| strand(s as f32))).unwrap();
    groom.widths = Some(vec![1e-4; 60]);
    groom.colours = Some(vec![[0.5; 3]; 60]);
    groom.root_uvs = Some(vec![[0.5; 2]; 20]);
    groom.labels = Labels {
        group_ids: Some((0..20).collect()),
        guides: Some(vec![true; 20]),
        closest_guides: Some(vec![[1, 2, 3]; 20]),
        ..Labels::default()
    };
    let whole = alembic::write(&groom).unwrap();
    let limit = 8 * whole.len() + (1 << 14);
    assert!(counted(|| read_archive(&whole)).0 < limit);
    // Seeded, so that a failure can be repeated.
    let mut state = 1u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut worst = 0;
    for turn in 0..20_000 {
        let mut bytes = whole.clone();
        for _ in 0..=random(4) {
            let at = random(bytes.len());
            bytes[at] = match random(4) {
                0 => 0,
                1 => 0xff,
                2 => bytes[at] ^ 1 << random(8),
                _ => random(256) as u8,
            };
        }
        if turn % 5 == 0 {
            bytes.truncate(random(bytes.len()));
        }
        if turn % 7 == 0 {
            // An offset or count becomes another one of the file.
            let [from, to] = [0; 2].map(|_: u8| random((whole.len() - 8) / 4) * 4);
            bytes.resize(whole.len(), 0);
            bytes.copy_within(from..from + 8, to);
        }
        worst = worst.max(counted(|| read_archive(&bytes)).0);
        assert!(worst < limit, "turn {turn}: {worst} bytes for a file of {}", bytes.len());
    }
    eprintln!("at most {worst} bytes of memory for a file of {}", whole.len());
}

#[test]
fn many_empty_strands_take_little_memory() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let text = format!("v 0 0 0\nv 0 1 0\n{}l 1 2\n", "l\n".repeat(10_000));
    let (most, read) = counted(|| obj::read_groom(text.as_bytes()).unwrap());
    assert_eq!((read.strand_count(), read.particle_count()), (10_001, 2));
    assert!(most < 20 * text.len(), "{most} bytes for a file of {}", text.len());
}
