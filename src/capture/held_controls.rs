//! The camera's automatic controls, held while a recording runs, over the interruptions of its camera: one that was
//! unplugged has its automatic exposure on again.

use std::future::Future;
use std::pin::Pin;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::task::JoinHandle;

use super::source::RecordedSource;
use crate::shutdown::Shutdown;

/// How long the controls of a camera settle after it was opened.
pub const SETTLE_TIME: Duration = Duration::from_secs(2);

/// Holds the camera's automatic controls until the shutdown, once they have settled for this long; the flag is true while
/// they are held.
pub type HoldControls =
    Arc<dyn Fn(Shutdown, Duration, Arc<AtomicBool>) -> Pin<Box<dyn Future<Output = ()> + Send>> + Send + Sync>;

/// Controls that are held in the background.
pub struct HeldControls {
    hold: HoldControls,
    is_held: Arc<AtomicBool>,
    current: ControlsHold,
}

struct ControlsHold {
    release: Shutdown,
    task: JoinHandle<()>,
}

impl HeldControls {
    /// Holds them once they have settled. The flag is true while they are held.
    pub fn begin(hold: HoldControls, settle: Duration, is_held: Arc<AtomicBool>) -> Self {
        let current = ControlsHold::begin(&hold, settle, &is_held, None);
        Self { hold, is_held, current }
    }

    /// The camera was opened again. The hold before is released first: it is of a camera that was unplugged, and the note
    /// of what was switched off has one place.
    pub fn hold_again(&mut self, settle: Duration) {
        let release = Shutdown::new(); // replaced at once
        let before = std::mem::replace(&mut self.current, ControlsHold { release, task: tokio::spawn(async {}) });
        self.current = ControlsHold::begin(&self.hold, settle, &self.is_held, Some(before));
    }

    /// Begins to release them.
    pub fn release(&self) {
        self.current.release.begin();
    }

    /// Releases them, and waits until that is done.
    pub async fn end(self) {
        self.release();
        let _ = self.current.task.await; // a panic is logged where it happened
    }
}

impl ControlsHold {
    fn begin(hold: &HoldControls, settle: Duration, is_held: &Arc<AtomicBool>, before: Option<Self>) -> Self {
        let release = Shutdown::new();
        let held = hold(release.clone(), settle, is_held.clone());
        let task = tokio::spawn(async move {
            if let Some(before) = before {
                before.release.begin();
                let _ = before.task.await; // as above
            }
            held.await;
        });
        Self { release, task }
    }
}

/// The controls of a source that is opened again when it is interrupted. Clones are the same controls.
#[derive(Clone, Default)]
pub struct SourceControls(Arc<Mutex<Option<HeldControls>>>);

impl SourceControls {
    /// Holds the controls of a source that was just opened, and again each time that it is opened again.
    pub fn hold(source: &mut RecordedSource, hold: HoldControls) -> Self {
        let controls = Self(Arc::new(Mutex::new(Some(HeldControls::begin(hold, SETTLE_TIME, Arc::default())))));
        let held = controls.clone();
        source.when_opened_again(move || {
            let mut held = held.0.lock().unwrap_or_else(PoisonError::into_inner); // one assignment
            held.iter_mut().for_each(|held| held.hold_again(SETTLE_TIME));
        });
        controls
    }

    /// Releases them, and waits until that is done.
    pub async fn end(self) {
        let held = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(held) = held {
            held.end().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::net::TcpListener;
    use std::process::Command;
    use std::sync::atomic::Ordering;

    use super::*;
    use crate::capture::source::{OpenSource, SourceEvent, SourcePatience};
    use crate::media::CaptureSource;

    /// Serves a stream of a second to two readers, and closes each connection at its end.
    fn stream_that_is_cut_once() -> String {
        let mut ffmpeg = Command::new("ffmpeg");
        ffmpeg.args(["-v", "error", "-f", "lavfi", "-i", "testsrc2=size=64x48:rate=25", "-t", "1"]);
        let made = ffmpeg.args(["-c:v", "libx264", "-g", "5", "-f", "mpegts", "-"]).output().unwrap();
        assert!(made.status.success());
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("tcp://{}", listener.local_addr().unwrap());
        std::thread::spawn(move || {
            for _ in 0..2 {
                let (mut reader, _) = listener.accept().unwrap();
                let _ = reader.write_all(&made.stdout); // a reader may have enough of it
            }
        });
        address
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn the_controls_of_one_recording_are_held_again_when_its_source_is_back() {
        let address = stream_that_is_cut_once();
        let open: OpenSource =
            Arc::new(move |stop| CaptureSource::open(&address, &[], move || stop.load(Ordering::Relaxed)));
        let patience = SourcePatience { silence: Duration::from_secs(5), outage: Duration::from_secs(30) };
        let mut source = RecordedSource::open(open, patience).await.unwrap().unwrap();
        let noted: Arc<Mutex<Vec<&'static str>>> = Arc::default();
        let notes = noted.clone();
        let hold: HoldControls = Arc::new(move |release, settle, _| {
            assert_eq!(settle, SETTLE_TIME);
            let notes = notes.clone();
            Box::pin(async move {
                notes.lock().unwrap().push("held");
                release.begun().await;
                notes.lock().unwrap().push("released");
            })
        });
        let controls = SourceControls::hold(&mut source, hold);
        let mut frames = 0;
        loop {
            match source.next().await {
                SourceEvent::Frame(_) => frames += 1,
                SourceEvent::Resumed(..) => break,
                other => panic!("{other:?}"),
            }
        }
        assert!(frames > 20, "{frames}");
        controls.end().await;
        assert_eq!(*noted.lock().unwrap(), ["held", "released", "held", "released"]);
    }
}
