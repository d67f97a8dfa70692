// The device's cameras: listing them, opening one, and locking its exposure and white balance.

/** Our slugs for the names of the browser's errors. */
const FAULTS = {
  NotAllowedError: 'denied',
  SecurityError: 'denied',
  NotFoundError: 'none',
  NotReadableError: 'busy',
  AbortError: 'busy',
  OverconstrainedError: 'none',
};
/** Modes of a camera that change the colours of a tape during training. */
const MODES = ['exposureMode', 'whiteBalanceMode'];

export class CameraFault extends Error {
  /** `slug`: `insecure`, `unsupported`, `denied`, `none`, `busy`. */
  constructor(slug) {
    super(slug);
    this.slug = slug;
  }
}

/** Why this browser cannot record on this page; null if it can. */
export function recordingFault() {
  if (!isSecureContext || !navigator.mediaDevices?.getUserMedia) return new CameraFault('insecure');
  const canGrabFrames = 'MediaStreamTrackProcessor' in window || 'requestVideoFrameCallback' in HTMLVideoElement.prototype;
  return canGrabFrames && 'OffscreenCanvas' in window ? null : new CameraFault('unsupported');
}

/** Whether the camera was allowed before, so that the browser will not ask. False if the browser does not say. */
export async function isAllowed() {
  const answer = await navigator.permissions?.query({ name: 'camera' }).catch(() => null);
  return answer?.state === 'granted';
}

/** Cameras as `{ id, name }`; browsers give the names only once a camera may be used. */
export async function listCameras() {
  const devices = await navigator.mediaDevices.enumerateDevices();
  return devices
    .filter(({ kind, deviceId }) => kind === 'videoinput' && deviceId)
    .map(({ deviceId, label }, index) => ({ id: deviceId, name: label || `${index + 1}` }));
}

/** Opens a camera with the picture nearest to the wanted one; the browser must not scale or crop it. */
export async function openCamera({ camera, width, height, rate }) {
  const video = {
    width: { ideal: width },
    height: { ideal: height },
    frameRate: { ideal: rate },
    resizeMode: { ideal: 'none' },
  };
  const selector = camera ? { deviceId: { exact: camera } } : { facingMode: { ideal: 'environment' } };
  const ask = more => navigator.mediaDevices.getUserMedia({ audio: false, video: { ...video, ...more } });
  try {
    return await ask(selector).catch(error => {
      if (camera && error.name === 'OverconstrainedError') return ask({}); // The chosen one is gone: any other.
      throw error;
    });
  } catch (error) {
    throw new CameraFault(FAULTS[error.name] ?? 'busy');
  }
}

/** The modes of this camera that cannot be locked. */
export function uncontrolledModes(track) {
  const capabilities = track.getCapabilities?.() ?? {};
  return MODES.filter(mode => !capabilities[mode]?.includes('manual'));
}

/** Locks exposure and white balance as they are now, or releases them; what a camera lacks is left alone. */
export async function lockSettings(track, isLocked) {
  const capabilities = track.getCapabilities?.() ?? {};
  const wanted = isLocked ? 'manual' : 'continuous';
  // The settings show whether it worked.
  const set = constraints => track.applyConstraints(constraints).catch(() => {});
  for (const mode of MODES.filter(one => capabilities[one]?.includes('manual') && capabilities[one].includes(wanted))) {
    const advanced = [{ [mode]: wanted }];
    // By the standard, constraints that are not repeated are dropped.
    await set({ ...track.getConstraints(), advanced });
    if (track.getSettings()[mode] !== wanted) await set({ advanced }); // Chromium accepts them only on their own.
  }
}
