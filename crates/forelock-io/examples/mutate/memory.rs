//! The memory that an execution takes.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// A single allocation above this ends the program, bytes.
const LARGEST: usize = 4 << 30;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static BEFORE: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);
/// The execution under way: reader, seed and number.
static EXECUTION: Mutex<(&str, u64, u64)> = Mutex::new(("", 0, 0));

/// The system's allocator, counted.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Counts `bytes` more, and says whose they are if they are too many to be had.
fn count(bytes: usize) {
    if bytes > LARGEST
        && let Ok(execution) = EXECUTION.try_lock()
    {
        // Unbuffered: this takes no memory.
        eprintln!("{execution:?}: an allocation of {bytes} bytes");
        std::process::abort();
    }
    let live = LIVE.fetch_add(bytes, Relaxed) + bytes;
    if live > MOST.load(Relaxed) {
        MOST.fetch_max(live, Relaxed);
    }
}

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        LIVE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Counts from here on, for execution `number` of `reader`.
pub fn begin(reader: &'static str, seed: u64, number: u64) {
    if let Ok(mut execution) = EXECUTION.lock() {
        *execution = (reader, seed, number);
    }
    let live = LIVE.load(Relaxed);
    BEFORE.store(live, Relaxed);
    MOST.store(live, Relaxed);
}

/// The most bytes at once since [`begin`]. While a block grows, both its sizes count.
pub fn most() -> usize {
    MOST.load(Relaxed) - BEFORE.load(Relaxed)
}
