// A device that several people use, such as the tablet of a lab: "Next person" signs out and keeps box and task, and a person
// who forgets to sign out is signed out by the page.
const KEY = 'trocar.shared';
const TARGET_KEY = 'trocar.shared.target';
export const IDLE_CHOICES_MIN = [2, 5, 10];
const DEFAULT_IDLE_MIN = 5;
const CHECK_MS = 5_000;
const changed = new EventTarget();

const stored = (key, fallback) => {
  try {
    return JSON.parse(localStorage.getItem(key) ?? 'null') ?? fallback;
  } catch {
    return fallback; // Storage is refused.
  }
};

const store = (key, value) => {
  try {
    localStorage.setItem(key, JSON.stringify(value));
  } catch {
    // Storage is refused: the choice lasts as long as this page.
  }
};

/** Minutes without a touch or key after which the page signs out; 0 on a device of one person. */
export const sharedIdleMinutes = () => Number(stored(KEY, 0)) || 0;

/** @param {boolean} isShared @param {number} [minutes] */
export function setShared(isShared, minutes = DEFAULT_IDLE_MIN) {
  store(KEY, isShared ? minutes : 0);
  changed.dispatchEvent(new Event('change'));
}

/** Calls back when the device becomes shared or one person's again, and when an upload begins or ends. */
export function onSharedChange(callback) {
  changed.addEventListener('change', callback);
  return () => changed.removeEventListener('change', callback);
}

let isSendingNow = false;

/** Whether this page sends an upload, which a sign-out would end. */
export const isSending = () => isSendingNow;

/** @param {boolean} sending */
export function setSending(sending) {
  if (sending === isSendingNow) return;
  isSendingNow = sending;
  changed.dispatchEvent(new Event('change'));
}

/** Keeps the box and task of the last recording or upload; never a trainee. */
export function rememberTarget({ box, task }) {
  if (sharedIdleMinutes() && (box || task)) store(TARGET_KEY, { box, task });
}

/** Where the next person begins: the page of the recording or upload, with the same box and task. */
export function nextPersonAddress({ path, query }) {
  const page = ['record', 'upload'].includes(path[0]) ? path[0] : 'record';
  const { box, task } = stored(TARGET_KEY, {});
  return { path: [page], query: { box: query.get('box') ?? box, task: query.get('task') ?? task } };
}

/** Calls back once when nothing was touched for the chosen time, unless `isBusy()`. Returns the function that ends it. */
export function watchIdle(onIdle, isBusy) {
  let last = Date.now();
  const touched = () => (last = Date.now());
  const events = ['pointerdown', 'pointermove', 'keydown', 'wheel', 'touchstart'];
  events.forEach(name => addEventListener(name, touched, { passive: true }));
  const timer = setInterval(() => {
    const minutes = sharedIdleMinutes();
    if (isBusy()) touched();
    else if (minutes && Date.now() - last > minutes * 60_000) (touched(), onIdle());
  }, CHECK_MS);
  return () => {
    clearInterval(timer);
    events.forEach(name => removeEventListener(name, touched));
  };
}
