// The recording of this browser, outside any page: it goes on while people look at other pages. One at a time.
import { api } from '../api.js';
import { hold } from './camera.js';
import { h264For } from './codec.js';
import { change, now, onRecording } from './current.js';
import { TICKS_PER_S } from './records.js';

/** How much of the browser's name is told to the service. */
const MOST_NAME = 200;

let parts = null;

/** Begins with the camera as it is open. `target` has the ids of trainee, task and box, `names` how people call them. */
export async function begin(stream, { target, names }) {
  const track = stream.getVideoTracks()[0].clone(); // The preview may end without the recording.
  await hold(track, true);
  const { width, height, frameRate = 30 } = track.getSettings();
  const h264 = await h264For({ width, height, frameRate });
  const worker = new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
  parts = { worker, track, source: null, lock: null };
  worker.onmessage = ({ data }) => hear(data);
  worker.onerror = ({ message }) => fail(message ? 'fault' : 'unloaded');
  track.onended = () => stop('camera'); // Where the worker does not see it by itself.
  for (const event of ['mute', 'unmute']) track.addEventListener(event, () => now && change({ isMuted: track.muted }));
  change(null);
  change({ phase: 'recording', names, isMuted: track.muted });
  const begins = { address: api.boxes.feedAddress(target.box), hello: helloOf(target), h264 };
  if (!handOver(worker, track, begins)) {
    parts.source = capture(worker, track, begins);
    change({ isCaptured: true });
  }
  addEventListener('beforeunload', warn);
  stayAwake();
}

/** All but the picture, which its first frame tells. */
const helloOf = target => ({
  type: 'hello',
  protocol: 1,
  recording: crypto.randomUUID(), // Where there is a camera, the page is secure and has it.
  trainee: target.trainee,
  task: target.task,
  time_base: [1, TICKS_PER_S],
  began_at: new Date().toISOString(),
  sender: `dashboard, ${navigator.userAgent}`.slice(0, MOST_NAME),
});

/** The camera's frames straight to the worker, where the browser has a way; false where it has none. */
function handOver(worker, track, begins) {
  if ('MediaStreamTrackProcessor' in window) {
    const { readable } = new MediaStreamTrackProcessor({ track });
    worker.postMessage({ begin: { ...begins, readable } }, [readable]);
    return true;
  }
  if (!('VideoFrame' in window)) return false;
  const theirs = track.clone();
  try {
    worker.postMessage({ begin: { ...begins, track: theirs } }, [theirs]); // Only workers have the processor in Safari.
    return true;
  } catch {
    theirs.stop(); // Tracks cannot be handed over in this browser.
    return false;
  }
}

/** Frame by frame from a video that nobody sees; it stands still while the tab is hidden. */
function capture(worker, track, begins) {
  worker.postMessage({ begin: begins });
  const video = Object.assign(document.createElement('video'), { muted: true, playsInline: true });
  video.srcObject = new MediaStream([track]);
  const grab = async (shownAt, { captureTime, mediaTime }) => {
    if (track.readyState !== 'live') return;
    video.requestVideoFrameCallback(grab);
    const timestamp = Math.round(captureTime ? captureTime * 1e3 : mediaTime * 1e6);
    let frame;
    try {
      frame = 'VideoFrame' in window ? new VideoFrame(video, { timestamp }) : await createImageBitmap(video);
    } catch {
      return; // the camera is just being let go: the video has no picture any more
    }
    worker.postMessage({ frame, timestamp }, [frame]);
  };
  video.requestVideoFrameCallback(grab);
  video.play();
  return video;
}

function hear(data) {
  if (data.type === 'stopped') return stopped(data.why);
  if (data.type === 'nothing') return end('nothing');
  const { type, ...standing } = data;
  const before = now;
  change(standing);
  // A browser does not tell whether it was the network or the sign-in: asking does, and leads to the page for it.
  if (now.line === 'lost' && before.line !== 'lost') api.me().catch(() => {});
  if (['ended', 'shortened'].includes(now.line)) end(now.line);
  if (now.line === 'refused' && before.line !== 'refused') refuse();
}

/** Ends the recording; what is not on the server yet goes on being sent. */
export function stop(why = null) {
  if (now?.phase !== 'recording') return;
  parts.worker.postMessage({ stop: true });
  stopped(why);
}

function stopped(why) {
  if (now.phase !== 'recording') return;
  letGo();
  change({ phase: 'sending', why });
}

/** The service takes no more of it: it stops, and what is kept stays kept until the person decides. */
function refuse() {
  letGo();
  parts.worker.postMessage({ stop: true });
  change({ phase: 'refused' });
}

/** Without its worker nothing goes on. */
function fail(why) {
  end('failed');
  change({ why });
}

/** Sends what is left of a recording that was refused. */
export function retry() {
  change({ phase: 'sending', line: 'connecting' });
  parts.worker.postMessage({ retry: true });
}

/** Forgets the recording, and what is left of it. */
export function forget() {
  if (!now) return;
  end(now.phase);
  change(null);
}

function end(phase) {
  letGo();
  parts.worker.terminate();
  removeEventListener('beforeunload', warn);
  change({ phase });
}

/** The camera is the preview's alone again, its exposure free. */
function letGo() {
  const { track, source, lock } = parts;
  source?.pause();
  lock?.release();
  track.onended = null;
  hold(track, false).finally(() => track.stop());
}

function warn(event) {
  event.preventDefault();
  event.returnValue = ''; // What older browsers look at.
}

/** A tablet that falls asleep would take the camera with it. */
async function stayAwake() {
  const of = parts;
  const ask = async () => {
    if (document.hidden || now?.phase !== 'recording' || parts !== of) return;
    of.lock = await navigator.wakeLock?.request('screen').catch(() => null); // Low battery: it says no.
  };
  document.addEventListener('visibilitychange', ask); // It is taken away from hidden pages.
  const off = onRecording(() => {
    if (parts === of && now?.phase === 'recording') return;
    document.removeEventListener('visibilitychange', ask);
    off();
  });
  await ask();
}
