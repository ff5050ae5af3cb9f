//! A damaged archive never panics a reader, and never makes it take more memory than a small
//! multiple of the file. This is a test program of its own because the counter covers the whole
//! process.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    io::Cursor,
    sync::atomic::{AtomicUsize, Ordering},
};

use forelock_core::groom::Groom;
use forelock_io::alembic::{self, Labels};
use glam::Vec3;

struct Counting;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let live = LIVE.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(live, Ordering::Relaxed);
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

/// The largest number of bytes that reading takes beyond what there is before.
fn peak(bytes: &[u8]) -> usize {
    let before = LIVE.load(Ordering::SeqCst);
    PEAK.store(before, Ordering::SeqCst);
    if let Ok(mut reader) = alembic::Reader::open(Cursor::new(bytes)) {
        let _ = (reader.read(0), reader.read(reader.frames().wrapping_sub(1)));
    }
    PEAK.load(Ordering::SeqCst) - before
}

#[test]
fn damaged_archives_neither_panic_nor_take_much_memory() {
    let strand = |x: f32| [Vec3::ZERO, Vec3::new(x, -0.1, 0.0), Vec3::new(x, -0.2, 0.0)];
    let mut groom = Groom::from_strands((0..20).map(|s| strand(s as f32))).unwrap();
    groom.widths = Some(vec![1e-4; 60]);
    groom.colours = Some(vec![[0.5; 3]; 60]);
    groom.root_uvs = Some(vec![[0.5; 2]; 20]);
    let labels = Labels { group_ids: Some((0..20).collect()), guides: Some(vec![true; 20]), ids: None };
    let whole = alembic::write(&groom, &labels).unwrap();
    let limit = 8 * whole.len() + (1 << 14);
    assert!(peak(&whole) < limit);
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
        worst = worst.max(peak(&bytes));
        assert!(worst < limit, "turn {turn}: {worst} bytes for a file of {}", bytes.len());
    }
    eprintln!("at most {worst} bytes of memory for a file of {}", whole.len());
}
