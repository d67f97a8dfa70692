//! How the tracker's memory grows with a recording's length, counted byte by byte.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use trocar::simulation::{Scenario, Setup, Skill};
use trocar::vision::frame::Frame;
use trocar::vision::trajectory::PathKind;

use crate::truth::Recording;

/// Maximum bytes that one frame of one tool may add to the peak. During tracking its record takes 532 bytes; at the end
/// its motion takes 240 and a path 176. All paths and all steps of the smoother at once would take 2,000.
const MAX_BYTES_PER_FRAME_AND_TOOL: f64 = 600.0;

/// An allocator that counts the bytes that each thread holds.
struct CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    let held = HELD.get() + bytes;
    HELD.set(held);
    PEAK.set(PEAK.get().max(held));
}

// SAFETY: the system's allocator does all the work; counting allocates nothing.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size().cast_signed());
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count(-layout.size().cast_signed());
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size.cast_signed() - layout.size().cast_signed());
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(at, layout, size) }
    }
}

/// Peak of the bytes that this thread holds while `frames` frames are tracked and a path is made from them.
fn peak_bytes(recording: &Recording, frames: usize) -> isize {
    let before = HELD.get();
    PEAK.set(before);
    let mut tracker = recording.tracker(recording.world.rig.camera);
    for index in 0..frames {
        let time_s = index as f64 / 25.0;
        tracker.observe(&Frame { index: index as u64, time_s, ..recording.frame(0) });
    }
    let tracking = tracker.finish();
    let path = tracking.trajectory(PathKind::Smoothed);
    assert_eq!(path.samples.len(), frames * path.tools.len(), "every tool is in sight all the time");
    PEAK.get() - before
}

#[test]
fn an_hour_takes_little_more_memory_than_a_minute() {
    const SHORT: usize = 512; // enough poses for every estimate that uses a limited number of them
    const LONG: usize = 2048;
    let setup = Setup { width: 640, height: 360, ..Setup::new(Scenario::Rest, Skill::INTERMEDIATE, 21) };
    let recording = Recording::with(&setup, Some(1));
    let tools = recording.world.tools.len();
    let more = peak_bytes(&recording, LONG) - peak_bytes(&recording, SHORT);
    let per_frame = more as f64 / ((LONG - SHORT) * tools) as f64;
    eprintln!("{per_frame:.0} bytes per frame and tool");
    assert!(per_frame < MAX_BYTES_PER_FRAME_AND_TOOL, "{per_frame:.0} bytes per frame and tool");
}
