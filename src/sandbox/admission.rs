//! The child's first steps: receive the request and descriptors, confine itself, then read them.

use std::fs::File;
use std::io::{self, IoSliceMut, Read};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;

use rustix::net::{RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, recvmsg};

use super::budget::LandlockPolicy;
use super::confinement::{self, Confinement, ConfinementError, LandlockStatus, system_error};

/// Most descriptors handed to one child (the kernel passes at most 253 with a message).
pub const MAX_INPUTS: usize = 250;

/// The request and inputs of a confined child.
pub struct Admission {
    /// The request's bytes from the parent.
    pub request: Vec<u8>,
    /// Its inputs, open for reading, in the parent's order.
    pub inputs: Vec<File>,
    /// How much of Landlock is enforced.
    pub enforced: LandlockStatus,
}

/// Confines this process and returns its request. Call it first in a process that has no other thread: all descriptors
/// beyond the standard streams are closed.
pub fn admit() -> Result<Admission, ConfinementError> {
    confinement::tie_to_parent()?;
    close_inherited()?;
    let socket: UnixStream =
        io::stdin().as_fd().try_clone_to_owned().map_err(system_error("opening the request"))?.into();
    let (preamble, inputs) = receive(&socket).map_err(system_error("receiving the preamble"))?;
    let enforced = preamble.confinement.enter()?;
    let mut request = vec![0; preamble.request_bytes as usize];
    // Read as a file: the filter allows `read` but no socket calls.
    File::from(OwnedFd::from(socket)).read_exact(&mut request).map_err(system_error("reading the request"))?;
    Ok(Admission { request, inputs, enforced })
}

/// Closes descriptors that a library of the parent left inheritable; Rust leaves none.
fn close_inherited() -> Result<(), ConfinementError> {
    // SAFETY: called before this process opened anything, so no object owns a descriptor above the standard streams.
    let failed = unsafe { libc::close_range(3, libc::c_uint::MAX, 0) } != 0;
    if failed { Err(system_error("closing inherited files")(io::Error::last_os_error())) } else { Ok(()) }
}

/// The first message of the parent. Its fixed length lets it be read completely, with the descriptors that travel with
/// it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Preamble {
    pub(super) confinement: Confinement,
    pub(super) request_bytes: u64,
}

impl Preamble {
    const WORDS: usize = 7;
    const BYTES: usize = Self::WORDS * 8;

    pub(super) fn to_bytes(self) -> Vec<u8> {
        let Confinement { parent, memory_bytes, cpu_s, slice_ns, file_bytes, landlock } = self.confinement;
        let required = u64::from(landlock == LandlockPolicy::Required);
        let words: [u64; Self::WORDS] =
            [u64::from(parent), self.request_bytes, memory_bytes, cpu_s, required, file_bytes, slice_ns];
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    fn from_bytes(bytes: &[u8; Self::BYTES]) -> Self {
        let word = |i: usize| u64::from_le_bytes(bytes.as_chunks().0[i]);
        let landlock = if word(4) == 1 { LandlockPolicy::Required } else { LandlockPolicy::IfAvailable };
        let (parent, memory_bytes, cpu_s, file_bytes, slice_ns) = (word(0) as u32, word(2), word(3), word(5), word(6));
        let confinement = Confinement { parent, memory_bytes, cpu_s, slice_ns, file_bytes, landlock };
        Self { confinement, request_bytes: word(1) }
    }
}

fn receive(socket: &UnixStream) -> io::Result<(Preamble, Vec<File>)> {
    let mut bytes = [0; Preamble::BYTES];
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(MAX_INPUTS))];
    let mut control = RecvAncillaryBuffer::new(&mut space);
    let message = recvmsg(socket, &mut [IoSliceMut::new(&mut bytes)], &mut control, RecvFlags::CMSG_CLOEXEC)?;
    let inputs = control
        .drain()
        .filter_map(|message| match message {
            RecvAncillaryMessage::ScmRights(descriptors) => Some(descriptors),
            _ => None,
        })
        .flatten()
        .map(File::from)
        .collect();
    let mut socket = socket;
    socket.read_exact(&mut bytes[message.bytes..])?;
    Ok((Preamble::from_bytes(&bytes), inputs))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preamble_survives_its_bytes() {
        let landlock = LandlockPolicy::Required;
        let confinement = Confinement {
            parent: 4711,
            memory_bytes: 1 << 30,
            cpu_s: 3600,
            slice_ns: 20,
            file_bytes: 1 << 33,
            landlock,
        };
        let preamble = Preamble { confinement, request_bytes: 99 };
        let bytes = preamble.to_bytes().try_into().unwrap();
        assert_eq!(Preamble::from_bytes(&bytes), preamble);
    }
}
