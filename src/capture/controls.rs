//! Switches off a camera's automatic controls: Video4Linux controls.
//!
//! Automatic exposure and white balance change the tapes' colours during training. Each automatic is switched off at
//! the value that it has found, so that the picture stays as it is. An automatic that was off already was set by hand
//! and stays as it is.
//!
//! What is switched off is noted in a file first: an agent that is killed cannot restore it, but the next one does
//! ([`restore_automatics`]).

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use rustix::ioctl::{Opcode, Updater, ioctl, opcode};

/// A control that a camera regulates automatically, with its Linux numbers (`linux/v4l2-controls.h`).
struct AutomaticControl {
    name: &'static str,
    switch: u32,
    /// Value of the switch that turns the automatic off.
    off: i32,
    /// The control that the automatic regulates.
    value: u32,
}

/// In the order of switching off: in many cameras the gain follows the exposure.
const AUTOMATICS: [AutomaticControl; 3] = [
    AutomaticControl { name: "exposure", switch: 0x009a_0901, off: 1, value: 0x009a_0902 },
    AutomaticControl { name: "gain", switch: 0x0098_0912, off: 0, value: 0x0098_0913 },
    AutomaticControl { name: "white balance", switch: 0x0098_090c, off: 0, value: 0x0098_091a },
];

/// Access to a camera's controls by their numbers.
pub trait CameraControls {
    /// Value of the control, or `None` if the camera has no such control.
    fn get(&self, id: u32) -> io::Result<Option<i32>>;
    /// Sets the control.
    fn set(&mut self, id: u32, value: i32) -> io::Result<()>;
}

/// The result for one automatic.
#[derive(Debug)]
pub enum LockResult {
    /// Switched off at the value that it had found, if the camera reports one.
    Off(Option<i32>),
    /// It was off already.
    WasOff,
    /// The camera has no such automatic.
    Absent,
    /// The camera refused.
    Refused(io::Error),
}

/// The switches that were on and their values, for the next agent.
#[derive(Debug, Serialize, Deserialize)]
struct LockNote {
    camera: PathBuf,
    were: Vec<(u32, i32)>,
}

/// A camera whose automatics stay off while this exists. Dropping it restores them.
pub struct CameraLock<C: CameraControls> {
    controls: C,
    note: LockNote,
    note_path: PathBuf,
}

impl<C: CameraControls> CameraLock<C> {
    /// Switches a camera's automatics off, notes them in a file, and returns the result for each.
    pub fn new(controls: C, camera: &Path, note_path: &Path) -> (Self, Vec<(&'static str, LockResult)>) {
        let note = LockNote { camera: camera.to_owned(), were: Vec::new() };
        let mut lock = Self { controls, note, note_path: note_path.to_owned() };
        let results = AUTOMATICS.iter().map(|automatic| (automatic.name, lock.switch_off(automatic)));
        let results = results.collect();
        (lock, results)
    }

    fn switch_off(&mut self, automatic: &AutomaticControl) -> LockResult {
        let was = match self.controls.get(automatic.switch) {
            Ok(Some(was)) if was == automatic.off => return LockResult::WasOff,
            Ok(Some(was)) => was,
            Ok(None) => return LockResult::Absent,
            Err(error) => return LockResult::Refused(error),
        };
        // Read it first: many cameras return to the last manual value when the automatic is switched off.
        let found = match self.controls.get(automatic.value) {
            Ok(found) => found,
            Err(error) => return LockResult::Refused(error),
        };
        self.note.were.push((automatic.switch, was));
        match self.write_note().and_then(|()| self.fix_value(automatic, found)) {
            Ok(()) => LockResult::Off(found),
            Err(error) => {
                // At another value the picture would be worse than with the automatic.
                let _ = self.controls.set(automatic.switch, was); // a failure here is reported as `Refused` too
                self.note.were.pop();
                LockResult::Refused(error)
            }
        }
    }

    fn fix_value(&mut self, automatic: &AutomaticControl, found: Option<i32>) -> io::Result<()> {
        self.controls.set(automatic.switch, automatic.off)?;
        found.map_or(Ok(()), |found| self.controls.set(automatic.value, found))
    }

    /// Writes the note in one step: the file has either the old or the new content.
    fn write_note(&self) -> io::Result<()> {
        let new = self.note_path.with_extension("new");
        fs::write(&new, serde_json::to_vec(&self.note)?)?;
        fs::rename(new, &self.note_path)
    }
}

/// Switches on what an earlier agent switched off and, because it was killed, left off.
///
/// # Errors
/// The camera cannot be restored, or is gone; the note is removed all the same.
pub fn restore_automatics<C: CameraControls>(
    note_path: &Path,
    open: impl FnOnce(&Path) -> io::Result<C>,
) -> io::Result<()> {
    let note = match fs::read(note_path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        read => read?,
    };
    fs::remove_file(note_path)?;
    let note: LockNote = serde_json::from_slice(&note)?;
    restore(&mut open(&note.camera)?, &note)
}

/// Restores in reverse order and tries all.
fn restore(controls: &mut impl CameraControls, note: &LockNote) -> io::Result<()> {
    let switched: Vec<io::Result<()>> =
        note.were.iter().rev().map(|(switch, was)| controls.set(*switch, *was)).collect();
    switched.into_iter().collect()
}

impl<C: CameraControls> Drop for CameraLock<C> {
    fn drop(&mut self) {
        let _ = restore(&mut self.controls, &self.note); // an unplugged camera loses the settings anyway
        let _ = fs::remove_file(&self.note_path); // absent if nothing was switched off
    }
}

/// A camera's device file.
pub struct CameraDevice(File);

impl CameraDevice {
    /// Opens it while another process reads its frames.
    pub fn open(path: &Path) -> io::Result<Self> {
        File::options().read(true).write(true).open(path).map(Self)
    }
}

/// `struct v4l2_control`.
#[repr(C)]
#[derive(Clone, Copy)]
struct RawControl {
    id: u32,
    value: i32,
}

const GET_CONTROL: Opcode = opcode::read_write::<RawControl>(b'V', 27);
const SET_CONTROL: Opcode = opcode::read_write::<RawControl>(b'V', 28);

impl CameraControls for CameraDevice {
    fn get(&self, id: u32) -> io::Result<Option<i32>> {
        let mut control = RawControl { id, value: 0 };
        // SAFETY: VIDIOC_G_CTRL reads and writes a `v4l2_control`, the layout of `RawControl`.
        match unsafe { ioctl(&self.0, Updater::<GET_CONTROL, RawControl>::new(&mut control)) } {
            Ok(()) => Ok(Some(control.value)),
            Err(rustix::io::Errno::INVAL) => Ok(None), // no such control
            Err(error) => Err(error.into()),
        }
    }

    fn set(&mut self, id: u32, value: i32) -> io::Result<()> {
        let mut control = RawControl { id, value };
        // SAFETY: VIDIOC_S_CTRL reads and writes a `v4l2_control`, the layout of `RawControl`.
        Ok(unsafe { ioctl(&self.0, Updater::<SET_CONTROL, RawControl>::new(&mut control)) }?)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::BTreeMap;
    use std::rc::Rc;

    use tempfile::TempDir;

    use super::*;

    const EXPOSURE: u32 = 0x009a_0901;
    const TIME: u32 = 0x009a_0902;
    const WHITE: u32 = 0x0098_090c;
    const TEMPERATURE: u32 = 0x0098_091a;

    /// A camera that returns to its factory values when an automatic is switched off, as many do.
    #[derive(Clone, Default)]
    struct Webcam {
        says: Rc<RefCell<BTreeMap<u32, i32>>>,
        refuses: Option<u32>,
        does_not_tell: Option<u32>,
    }

    impl Webcam {
        fn new(says: &[(u32, i32)]) -> Self {
            Self { says: Rc::new(RefCell::new(says.iter().copied().collect())), ..Self::default() }
        }

        fn says(&self, id: u32) -> i32 {
            self.says.borrow()[&id]
        }
    }

    impl CameraControls for Webcam {
        fn get(&self, id: u32) -> io::Result<Option<i32>> {
            if self.does_not_tell == Some(id) {
                return Err(io::ErrorKind::ResourceBusy.into());
            }
            Ok(self.says.borrow().get(&id).copied())
        }

        fn set(&mut self, id: u32, value: i32) -> io::Result<()> {
            if self.refuses == Some(id) {
                return Err(io::ErrorKind::PermissionDenied.into());
            }
            let mut says = self.says.borrow_mut();
            says.insert(id, value);
            let forgotten = [(EXPOSURE, TIME, 156), (WHITE, TEMPERATURE, 4600)];
            says.extend(forgotten.iter().filter(|of| of.0 == id).map(|of| (of.1, of.2)));
            Ok(())
        }
    }

    fn lock(camera: &Webcam, folder: &TempDir) -> (CameraLock<Webcam>, Vec<(&'static str, LockResult)>) {
        CameraLock::new(camera.clone(), Path::new("/dev/video0"), &folder.path().join("note"))
    }

    fn fate(results: &[(&str, LockResult)], name: &str) -> String {
        results.iter().filter(|of| of.0 == name).map(|of| format!("{:?}", of.1)).collect()
    }

    #[test]
    fn automatics_are_off_at_what_they_had_found_and_as_before_afterwards() {
        let camera = Webcam::new(&[(EXPOSURE, 3), (TIME, 312), (WHITE, 1), (TEMPERATURE, 3900)]);
        let folder = tempfile::tempdir().unwrap();
        let (lock, results) = lock(&camera, &folder);
        assert_eq!([camera.says(EXPOSURE), camera.says(TIME)], [1, 312]);
        assert_eq!([camera.says(WHITE), camera.says(TEMPERATURE)], [0, 3900]);
        assert_eq!(fate(&results, "exposure"), "Off(Some(312))");
        assert_eq!(fate(&results, "gain"), "Absent");
        drop(lock);
        assert_eq!([camera.says(EXPOSURE), camera.says(WHITE)], [3, 1]);
    }

    #[test]
    fn settings_made_by_hand_stay() {
        let camera = Webcam::new(&[(EXPOSURE, 1), (TIME, 80), (WHITE, 0), (TEMPERATURE, 5000)]);
        let folder = tempfile::tempdir().unwrap();
        let (lock, results) = lock(&camera, &folder);
        assert_eq!(fate(&results, "exposure"), "WasOff");
        drop(lock);
        assert_eq!([camera.says(EXPOSURE), camera.says(TIME), camera.says(TEMPERATURE)], [1, 80, 5000]);
    }

    #[test]
    fn a_refusal_is_reported_and_the_other_automatics_are_off() {
        let camera = Webcam::new(&[(EXPOSURE, 3), (TIME, 312), (WHITE, 1), (TEMPERATURE, 3900)]);
        let refusing = Webcam { refuses: Some(EXPOSURE), ..camera.clone() };
        let folder = tempfile::tempdir().unwrap();
        let (_lock, results) = lock(&refusing, &folder);
        assert!(fate(&results, "exposure").starts_with("Refused"));
        assert_eq!(camera.says(WHITE), 0);
    }

    #[test]
    fn an_automatic_whose_value_cannot_be_held_stays_on() {
        let camera = Webcam::new(&[(EXPOSURE, 3), (TIME, 312), (WHITE, 1), (TEMPERATURE, 3900)]);
        for hindered in
            [Webcam { refuses: Some(TIME), ..camera.clone() }, Webcam { does_not_tell: Some(TIME), ..camera.clone() }]
        {
            let folder = tempfile::tempdir().unwrap();
            let (_lock, results) = lock(&hindered, &folder);
            assert!(fate(&results, "exposure").starts_with("Refused"));
            assert_eq!([camera.says(EXPOSURE), camera.says(WHITE)], [3, 0]);
        }
    }

    #[test]
    fn what_a_killed_agent_switched_off_the_next_one_switches_on() {
        let camera = Webcam::new(&[(EXPOSURE, 3), (TIME, 312), (WHITE, 1), (TEMPERATURE, 3900)]);
        let folder = tempfile::tempdir().unwrap();
        let (killed, _) = lock(&camera, &folder);
        std::mem::forget(killed);
        assert_eq!([camera.says(EXPOSURE), camera.says(WHITE)], [1, 0]);
        let note = folder.path().join("note");
        let open = |path: &Path| {
            assert_eq!(path, Path::new("/dev/video0"));
            Ok(camera.clone())
        };
        restore_automatics(&note, open).unwrap();
        assert_eq!([camera.says(EXPOSURE), camera.says(WHITE)], [3, 1]);
        restore_automatics(&note, |_| -> io::Result<Webcam> { panic!("there is nothing to restore") }).unwrap();

        let (orderly, _) = lock(&camera, &folder);
        drop(orderly);
        assert!(!note.exists());
    }

    #[test]
    fn requests_have_the_numbers_of_the_kernel() {
        assert_eq!([GET_CONTROL, SET_CONTROL].map(|opcode| opcode as u64), [0xc008_561b, 0xc008_561c]);
    }

    #[test]
    fn a_file_that_is_no_camera_has_no_controls() {
        let file = tempfile::NamedTempFile::new().unwrap();
        assert!(CameraDevice::open(file.path()).unwrap().get(EXPOSURE).is_err());
    }
}
