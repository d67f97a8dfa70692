//! Recordings with random damage: each child ends, and the parent continues.
//!
//! `TROCAR_MUTATIONS=10000` selects the long run; the seed of each file is its number, so a finding can be repeated.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use super::clips::{ffmpeg, test_picture};
use super::forge::{H264, Movie, avi, matroska, matroska_cluster, matroska_tracks};
use super::*;

/// Files in an ordinary run.
const DEFAULT_FILES: u64 = 200;

/// A small random generator: the same seed always gives the same file.
struct Seeded(u64);

impl Seeded {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }
}

fn damage(healthy: &[u8], seed: u64) -> Vec<u8> {
    let mut random = Seeded(seed);
    let mut bytes = healthy.to_vec();
    for _ in 0..=random.below(4) {
        let (at, length) = (random.below(bytes.len()), random.below(64) + 1);
        let end = (at + length).min(bytes.len());
        match random.below(7) {
            0 => bytes[at..end].fill(0),
            1 => bytes[at..end].fill(0xff),
            2 => (0..length).for_each(|_| {
                let at = random.below(bytes.len());
                bytes[at] ^= 1 << random.below(8);
            }),
            3 => bytes.truncate(at.max(16)),
            4 => drop(bytes.drain(at..end)),
            5 => {
                let copy = bytes[at..end].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, copy);
            }
            // The beginning holds the tables: numbers there do more harm.
            _ => {
                let at = random.below(bytes.len().min(2048));
                let number = [u32::MAX, 0x7fff_ffff, 0x8000_0000, 0][random.below(4)].to_be_bytes();
                let end = (at + 4).min(bytes.len());
                bytes[at..end].copy_from_slice(&number[..end - at]);
            }
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

fn healthy_recordings(folder: &Path) -> Vec<Vec<u8>> {
    let grey = H264 { columns: 20, rows: 15, references: 1 };
    let mut recordings = vec![
        Movie::valid().bytes(),
        matroska(&[matroska_tracks(&grey, 1), matroska_cluster(&grey.samples(20))]),
        avi(b"H264", [320, 240], &[], 1, &[]),
    ];
    let cases = [
        ("h264.mp4", "-c:v libx264 -preset ultrafast -bf 2"),
        ("h264.mkv", "-c:v libx264 -preset ultrafast"),
        ("h264.ts", "-c:v libx264 -preset ultrafast"),
        ("fragmented.mp4", "-c:v libx264 -preset ultrafast -movflags frag_keyframe+empty_moov"),
        ("hevc.mp4", "-c:v libx265 -preset ultrafast -x265-params log-level=none"),
        ("mjpeg.avi", "-c:v mjpeg"),
        ("mpeg4.avi", "-c:v mpeg4"),
        ("vp8.webm", "-c:v libvpx -deadline realtime"),
        ("vp9.webm", "-c:v libvpx-vp9 -deadline realtime -cpu-used 8"),
        ("rotated.mov", "-c:v libx264 -preset ultrafast -metadata:s:v:0 rotate=90"),
    ];
    for (name, codec) in cases {
        let Some(clip) = ffmpeg(&test_picture("160x120", 12, codec), &folder.join(name)) else { break };
        recordings.push(std::fs::read(clip).unwrap());
    }
    recordings
}

#[test]
fn damaged_recordings_neither_hang_nor_break_the_protocol() {
    let files = std::env::var_os("TROCAR_MUTATIONS")
        .map_or(DEFAULT_FILES, |text| text.to_str().unwrap().parse().expect("TROCAR_MUTATIONS is a number of files"));
    let folder = tempfile::tempdir().unwrap();
    let healthy = healthy_recordings(folder.path());
    let (next, findings) = (AtomicU64::new(0), Mutex::new(Vec::new()));
    let (decoded, explained, max_memory) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU64::new(0));
    let patience = Budget { wall: Duration::from_secs(60), ..budget() };
    std::thread::scope(|threads| {
        for worker in 0..2 {
            let path = folder.path().join(format!("damaged-{worker}"));
            let (next, findings, healthy, patience) = (&next, &findings, &healthy, &patience);
            let (decoded, explained, max_memory) = (&decoded, &explained, &max_memory);
            threads.spawn(move || {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= files {
                        return;
                    }
                    std::fs::write(&path, damage(&healthy[seed as usize % healthy.len()], seed)).unwrap();
                    let (result, cost) = probe_with(&path, patience);
                    max_memory.fetch_max(cost.peak_rss_bytes, Ordering::Relaxed);
                    match result {
                        Ok(_) => decoded.fetch_add(1, Ordering::Relaxed),
                        Err(AttemptFailure::Impossible(_)) => explained.fetch_add(1, Ordering::Relaxed),
                        Err(other) => {
                            findings.lock().unwrap().push(format!("file {seed}: {other:?}"));
                            0
                        }
                    };
                }
            });
        }
    });
    eprintln!(
        "{files} damaged files: {} decoded in part, {} explained, {} MiB at most",
        decoded.into_inner(),
        explained.into_inner(),
        max_memory.into_inner() >> 20
    );
    let findings = findings.into_inner().unwrap();
    assert!(findings.is_empty(), "\n{}\n", findings.join("\n"));
}
