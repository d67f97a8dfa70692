// The recording of this browser, outside any page: it continues while people look at other pages. One at a time.
import { api } from '../api.js';
import { lockSettings } from './camera.js';
import { h264For } from './codec.js';
import { currentRecording, onRecording, updateRecording } from './current_recording.js';
import { TICKS_PER_S } from './records.js';

/** How much of the browser's name is sent to the service. */
const MAX_NAME_LENGTH = 200;

/**
 * The running recording. Null only before the first one, when nothing uses it.
 *
 * @type {{ worker: Worker, track: MediaStreamTrack, source: HTMLVideoElement | null, lock: any }}
 */
let active = /** @type {any} */ (null);

/**
 * Starts with the camera as it is open. `target` has the ids of trainee, task and box, `names` the same as text for
 * people. For an attempt of an exam, `recording` is the id that the service ordered, and `exam` that of the exam.
 *
 * @param {MediaStream} stream
 * @param {{ target: any, names: string | null, recording?: string, exam?: string }} what
 */
export async function startRecording(stream, { target, names, recording, exam }) {
  const track = stream.getVideoTracks()[0].clone(); // The preview may end without the recording.
  await lockSettings(track, true);
  const { width, height, frameRate = 30 } = track.getSettings();
  const h264 = await h264For({ width, height, frameRate });
  const worker = new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
  active = { worker, track, source: null, lock: null };
  worker.onmessage = ({ data }) => handleMessage(data);
  worker.onerror = ({ message }) => fail(message ? 'fault' : 'unloaded');
  track.onended = () => stopRecording('camera'); // For browsers where the worker does not see it.
  for (const event of ['mute', 'unmute']) track.addEventListener(event, () => currentRecording && updateRecording({ isMuted: track.muted }));
  updateRecording(null);
  updateRecording({ phase: 'recording', names, exam, isMuted: track.muted });
  const beginMessage = { address: api.boxes.feedAddress(target.box), hello: helloOf(target, recording), h264 };
  if (!transferTrack(worker, track, beginMessage)) {
    active.source = capture(worker, track, beginMessage);
    updateRecording({ isCaptured: true });
  }
  addEventListener('beforeunload', warn);
  stayAwake();
}

/** Everything but the picture's size and codec, which depend on the first frame. */
const helloOf = (target, recording) => ({
  type: 'hello',
  protocol: 1,
  recording: recording ?? crypto.randomUUID(), // A page with a camera is a secure context and has it.
  trainee: target.trainee,
  task: target.task,
  time_base: [1, TICKS_PER_S],
  began_at: new Date().toISOString(),
  sender: `dashboard, ${navigator.userAgent}`.slice(0, MAX_NAME_LENGTH),
  resumes: false, // What is not sent is lost with the page.
});

/** Transfers the camera's frames straight to the worker, if the browser can; returns false if it cannot. */
function transferTrack(worker, track, beginMessage) {
  if ('MediaStreamTrackProcessor' in window) {
    const { readable } = new MediaStreamTrackProcessor({ track });
    worker.postMessage({ begin: { ...beginMessage, readable } }, [readable]);
    return true;
  }
  if (!('VideoFrame' in window)) return false;
  const workerTrack = track.clone();
  try {
    // In Safari, only workers have the processor.
    worker.postMessage({ begin: { ...beginMessage, track: workerTrack } }, [workerTrack]);
    return true;
  } catch {
    workerTrack.stop(); // This browser cannot transfer tracks.
    return false;
  }
}

/** Captures frame by frame from an invisible video, which stops while the tab is hidden. */
function capture(worker, track, beginMessage) {
  worker.postMessage({ begin: beginMessage });
  const video = Object.assign(document.createElement('video'), { muted: true, playsInline: true });
  video.srcObject = new MediaStream([track]);
  /** @type {(shownAt: number, times: { captureTime?: number, mediaTime: number }) => Promise<void>} */
  const grabFrame = async (shownAt, { captureTime, mediaTime }) => {
    if (track.readyState !== 'live') return;
    video.requestVideoFrameCallback(grabFrame);
    const timestamp = Math.round(captureTime ? captureTime * 1e3 : mediaTime * 1e6);
    let frame;
    try {
      frame = 'VideoFrame' in window ? new VideoFrame(video, { timestamp }) : await createImageBitmap(video);
    } catch {
      return; // the camera is just being released: the video has no picture any more
    }
    worker.postMessage({ frame, timestamp }, [frame]);
  };
  video.requestVideoFrameCallback(grabFrame);
  video.play();
  return video;
}

function handleMessage(data) {
  if (data.type === 'stopped') return handleStopped(data.why);
  if (data.type === 'nothing') return endRecording('nothing');
  const { type, ...status } = data;
  const before = currentRecording;
  updateRecording(status);
  // A browser does not say whether the network or the sign-in failed: this request does, and leads to the sign-in page.
  if (currentRecording.connection === 'lost' && before.connection !== 'lost') api.me().catch(() => {});
  if (['ended', 'shortened'].includes(currentRecording.connection)) endRecording(currentRecording.connection);
  if (currentRecording.connection === 'refused' && before.connection !== 'refused') handleRefusal();
}

/** Ends the recording; what is not on the server yet is still sent. */
export function stopRecording(why = /** @type {string | null} */ (null)) {
  if (currentRecording?.phase !== 'recording') return;
  active.worker.postMessage({ stop: true });
  handleStopped(why);
}

function handleStopped(why) {
  if (currentRecording.phase !== 'recording') return;
  releaseCamera();
  updateRecording({ phase: 'sending', why });
}

/** The service accepts no more: recording stops, and what is kept stays until the person decides. */
function handleRefusal() {
  releaseCamera();
  active.worker.postMessage({ stop: true });
  updateRecording({ phase: 'refused' });
}

/** Without its worker the recording cannot continue. */
function fail(why) {
  endRecording('failed');
  updateRecording({ why });
}

/** Sends the rest of a recording that was refused. */
export function retrySending() {
  updateRecording({ phase: 'sending', connection: 'connecting' });
  active.worker.postMessage({ retry: true });
}

/** Discards the recording, and what is left of it. */
export function discardRecording() {
  if (!currentRecording) return;
  endRecording(currentRecording.phase);
  updateRecording(null);
}

function endRecording(phase) {
  releaseCamera();
  active.worker.terminate();
  removeEventListener('beforeunload', warn);
  updateRecording({ phase });
}

/** Only the preview uses the camera again, and its exposure is released. */
function releaseCamera() {
  const { track, source, lock } = active;
  source?.pause();
  lock?.release();
  track.onended = null;
  lockSettings(track, false).finally(() => track.stop());
}

function warn(event) {
  event.preventDefault();
  event.returnValue = ''; // For older browsers.
}

/** A tablet that falls asleep would stop the camera. */
async function stayAwake() {
  const own = active;
  const ask = async () => {
    if (document.hidden || currentRecording?.phase !== 'recording' || active !== own) return;
    own.lock = await navigator.wakeLock?.request('screen').catch(() => null); // The browser refuses at low battery.
  };
  document.addEventListener('visibilitychange', ask); // Browsers release the lock on hidden pages.
  const unsubscribe = onRecording(() => {
    if (active === own && currentRecording?.phase === 'recording') return;
    document.removeEventListener('visibilitychange', ask);
    unsubscribe();
  });
  await ask();
}
