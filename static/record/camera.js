// The device's cameras: which there are, opening one, and keeping its exposure and white balance as they are.

/** What may go wrong, by the name of the browser's error. */
const FAULTS = {
  NotAllowedError: 'denied',
  SecurityError: 'denied',
  NotFoundError: 'none',
  NotReadableError: 'busy',
  AbortError: 'busy',
  OverconstrainedError: 'none',
};
/** Modes of a camera that change the colours of a tape while somebody trains. */
const MODES = ['exposureMode', 'whiteBalanceMode'];

export class CameraFault extends Error {
  /** `slug`: `insecure`, `unsupported`, `denied`, `none`, `busy`. */
  constructor(slug) {
    super(slug);
    this.slug = slug;
  }
}

/** Can this browser on this page record at all? Otherwise why not. */
export function fault() {
  if (!isSecureContext || !navigator.mediaDevices?.getUserMedia) return new CameraFault('insecure');
  const grabs = 'MediaStreamTrackProcessor' in window || 'requestVideoFrameCallback' in HTMLVideoElement.prototype;
  return grabs && 'OffscreenCanvas' in window ? null : new CameraFault('unsupported');
}

/** Was it allowed before, so that nobody need be asked? Where a browser does not tell, no. */
export async function isAllowed() {
  const answer = await navigator.permissions?.query({ name: 'camera' }).catch(() => null);
  return answer?.state === 'granted';
}

/** Cameras as `{ id, name }`; names are told only once a camera may be used. */
export async function cameras() {
  const devices = await navigator.mediaDevices.enumerateDevices();
  return devices
    .filter(({ kind, deviceId }) => kind === 'videoinput' && deviceId)
    .map(({ deviceId, label }, index) => ({ id: deviceId, name: label || `${index + 1}` }));
}

/** Opens a camera with the picture that is nearest to what is wanted; the browser must not scale or crop it. */
export async function open({ camera, width, height, rate }) {
  const video = {
    width: { ideal: width },
    height: { ideal: height },
    frameRate: { ideal: rate },
    resizeMode: { ideal: 'none' },
  };
  const which = camera ? { deviceId: { exact: camera } } : { facingMode: { ideal: 'environment' } };
  const ask = more => navigator.mediaDevices.getUserMedia({ audio: false, video: { ...video, ...more } });
  try {
    return await ask(which).catch(error => {
      if (camera && error.name === 'OverconstrainedError') return ask({}); // The chosen one is gone: any other.
      throw error;
    });
  } catch (error) {
    throw new CameraFault(FAULTS[error.name] ?? 'busy');
  }
}

/** The modes that this camera lets nobody hold. */
export function unheld(track) {
  const able = track.getCapabilities?.() ?? {};
  return MODES.filter(mode => !able[mode]?.includes('manual'));
}

/** Holds exposure and white balance as they are now, or lets them go; what a camera lacks is left alone. */
export async function hold(track, isHeld) {
  const able = track.getCapabilities?.() ?? {};
  const wanted = isHeld ? 'manual' : 'continuous';
  const set = constraints => track.applyConstraints(constraints).catch(() => {}); // Whether it took, the settings tell.
  for (const mode of MODES.filter(mode => able[mode]?.includes('manual') && able[mode].includes(wanted))) {
    const advanced = [{ [mode]: wanted }];
    await set({ ...track.getConstraints(), advanced }); // By the standard, what is not said again is given up.
    if (track.getSettings()[mode] !== wanted) await set({ advanced }); // Chromium takes them only by themselves.
  }
}
