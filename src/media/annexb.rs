//! Converts H.264 from the form used in containers to Annex B form, with FFmpeg's filter `h264_mp4toannexb`.

use std::ptr;

use ff::packet::{Mut, Ref};
use ff::{Packet, Rational, codec, ffi};
use ffmpeg_next as ff;

use super::mux::can_start_decoding;
use crate::domain::feed::FrameCodec;

/// Turns packets into access units in Annex B form; every key frame includes its parameter sets. Packets already in
/// this form stay unchanged.
pub(super) struct AnnexB(*mut ffi::AVBSFContext);

// SAFETY: a filter is not bound to a thread, and only its owner can use it.
unsafe impl Send for AnnexB {}

impl AnnexB {
    /// Creates a filter for a stream with these parameters.
    pub(super) fn new(parameters: &codec::Parameters, time_base: Rational) -> Result<Self, ff::Error> {
        let mut context = ptr::null_mut();
        // SAFETY: the name is a C string; the filter found is static; the context is allocated before anything is
        // written to it; the parameters live while they are copied; `Drop` frees the context after any failure.
        unsafe {
            let filter = ffi::av_bsf_get_by_name(c"h264_mp4toannexb".as_ptr());
            if filter.is_null() {
                return Err(ff::Error::BsfNotFound);
            }
            check(ffi::av_bsf_alloc(filter, &raw mut context))?;
            let made = Self(context);
            check(ffi::avcodec_parameters_copy((*context).par_in, parameters.as_ptr()))?;
            (*context).time_base_in = time_base.into();
            check(ffi::av_bsf_init(context))?;
            Ok(made)
        }
    }

    /// The access unit of a packet.
    pub(super) fn access_unit(&mut self, mut packet: Packet) -> Result<Vec<u8>, ff::Error> {
        let is_key = packet.is_key();
        let mut filtered = Packet::empty();
        // SAFETY: the context was initialised; both packets are valid, and the filter takes ownership of the first's
        // data.
        unsafe {
            check(ffi::av_bsf_send_packet(self.0, packet.as_mut_ptr()))?;
            check(ffi::av_bsf_receive_packet(self.0, filtered.as_mut_ptr()))?;
        }
        let unit = filtered.data().unwrap_or_default();
        if is_key && !can_start_decoding(FrameCodec::H264, unit) {
            return Ok([self.parameter_sets(), unit].concat());
        }
        Ok(unit.to_vec())
    }

    /// The parameter sets that the container states, in Annex B form.
    fn parameter_sets(&self) -> &[u8] {
        // SAFETY: the filter's output parameters live as long as the filter, and are not written to after
        // initialisation.
        unsafe {
            let stated = (*self.0).par_out;
            let length = usize::try_from((*stated).extradata_size).unwrap_or(0);
            match (*stated).extradata.is_null() {
                true => &[],
                false => std::slice::from_raw_parts((*stated).extradata, length),
            }
        }
    }
}

impl Drop for AnnexB {
    fn drop(&mut self) {
        // SAFETY: this value owns the context, and it is not used afterwards.
        unsafe { ffi::av_bsf_free(&raw mut self.0) }
    }
}

fn check(result: i32) -> Result<(), ff::Error> {
    if result < 0 { Err(ff::Error::from(result)) } else { Ok(()) }
}

/// True if the frame is needed to decode others, but must not be shown (an edit list of MP4).
pub(super) fn is_hidden(packet: &Packet) -> bool {
    // SAFETY: the packet is valid, and lives while its flags are read.
    unsafe { (*packet.as_ptr()).flags & ffi::AV_PKT_FLAG_DISCARD != 0 }
}
