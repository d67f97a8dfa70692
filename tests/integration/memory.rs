//! What a recording's length costs the tracker in memory, counted byte by byte.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use trocar::pipeline::frame::Frame;
use trocar::pipeline::trajectory::Kind;
use trocar::simulation::{Scenario, Setup, Skill};

use crate::truth::Recording;

/// Most bytes that a frame of one tool may add to the peak. While it is followed, its record takes 352; in the end its motion
/// takes 240 and a path 176. Where every path is kept at once, and every step of the smoother, it is 2,000.
const MOST_PER_FRAME_AND_TOOL: f64 = 480.0;

/// Counts what each thread holds.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    let held = HELD.get() + bytes;
    HELD.set(held);
    PEAK.set(PEAK.get().max(held));
}

// SAFETY: all is done by the system's allocator; counting allocates nothing.
unsafe impl GlobalAlloc for Counting {
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

/// The most that this thread holds at a time while so many frames are tracked and a path is made of them.
fn peak_bytes(recording: &Recording, frames: usize) -> isize {
    let before = HELD.get();
    PEAK.set(before);
    let mut tracker = recording.tracker(recording.world.rig.camera);
    for index in 0..frames {
        let time_s = index as f64 / 25.0;
        tracker.observe(&Frame { index: index as u64, time_s, ..recording.frame(0) });
    }
    let tracking = tracker.finish();
    let path = tracking.trajectory(Kind::Smoothed);
    assert_eq!(path.samples.len(), frames * path.tools.len(), "every tool is in sight all the time");
    PEAK.get() - before
}

#[test]
fn an_hour_takes_little_more_memory_than_a_minute() {
    const SHORT: usize = 512; // poses enough for all that is worked out from a limited number of them
    const LONG: usize = 2048;
    let setup = Setup { width: 640, height: 360, ..Setup::new(Scenario::Rest, Skill::INTERMEDIATE, 21) };
    let recording = Recording::with(&setup, Some(1));
    let tools = recording.world.tools.len();
    let more = peak_bytes(&recording, LONG) - peak_bytes(&recording, SHORT);
    let per_frame = more as f64 / ((LONG - SHORT) * tools) as f64;
    eprintln!("{per_frame:.0} bytes per frame and tool");
    assert!(per_frame < MOST_PER_FRAME_AND_TOOL, "{per_frame:.0} bytes per frame and tool");
}
