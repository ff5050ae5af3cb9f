//! Damaged files take no memory for what is not there. This is a test program of its own because
//! the counter covers the whole process.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Cursor;
use std::sync::atomic::{AtomicUsize, Ordering};

use forelock_core::groom::Groom;
use forelock_io::{Usd, usd};
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

/// The bytes that reading `bytes` takes at most, and whether they were read.
fn reading(bytes: &[u8]) -> (usize, bool) {
    let before = LIVE.load(Ordering::Relaxed);
    MOST.store(before, Ordering::Relaxed);
    let is_read = Usd::open(Cursor::new(bytes)).and_then(|layer| layer.frame(0)).is_ok();
    (MOST.load(Ordering::Relaxed) - before, is_read)
}

#[test]
fn damaged_layers_take_little_memory() {
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
        let (whole, is_read) = reading(bytes);
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
            most = most.max(reading(&damaged).0);
        }
        eprintln!("{} bytes: whole {whole}, damaged at most {most}", bytes.len());
        // Compressed tables may say that they are larger than they are, within a limit.
        assert!(most < 64 * bytes.len() + (2 << 20), "{most} bytes for a file of {}", bytes.len());
    }
}
