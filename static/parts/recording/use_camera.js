// The camera of this device while a page is mounted: opened when allowed, reopened when another camera or picture is
// chosen, closed with the page. Camera and rate are stored in this browser; the picture size depends on the box.
import { useCallback, useEffect, useRef, useState } from '../../preact.js';
import { CameraFault, isAllowed, listCameras, openCamera, recordingFault } from '../../record/camera.js';

const KEY = 'trocar.camera';

/**
 * Returns `stream` or null, `fault` (a slug) or null, `isOpening`, the `list` of cameras, `chosen`
 * (`{ camera, size, rate }`), `choose(more)` and `turnOn()`. `wanted` is the picture size if none was chosen, as
 * `1280x720`; the camera waits until it is known.
 */
export function useCamera(wanted) {
  const [chosen, setChosen] = useState(loadChoice);
  /**
   * @type {{ stream: MediaStream | null, fault: string | null, isOpening: boolean,
   *   list: { id: string, name: string }[] }}
   */
  const initial = { stream: null, fault: recordingFault()?.slug ?? null, isOpening: false, list: [] };
  const [state, setState] = useState(initial);
  const running = useRef({ stream: /** @type {MediaStream | null} */ (null), generation: 0 });
  const size = chosen.size || wanted;

  const close = () => {
    running.current.generation++;
    running.current.stream?.getTracks().forEach(track => track.stop());
    running.current.stream = null;
  };
  const turnOn = useCallback(async () => {
    if (recordingFault() || !size) return;
    close();
    const generation = running.current.generation;
    const isOutdated = () => generation !== running.current.generation;
    setState(before => ({ ...before, stream: null, fault: null, isOpening: true }));
    const [width, height] = size.split('x').map(Number);
    try {
      const stream = await openCamera({ camera: chosen.camera, width, height, rate: Number(chosen.rate) });
      if (isOutdated()) return stream.getTracks().forEach(track => track.stop());
      running.current.stream = stream;
      const handleEnded = () => !isOutdated() && setState(before => ({ ...before, stream: null, fault: 'gone' }));
      stream.getVideoTracks()[0].onended = handleEnded;
      setState({ stream, fault: null, isOpening: false, list: await listCameras() });
    } catch (error) {
      if (!(error instanceof CameraFault)) throw error;
      if (!isOutdated()) setState(before => ({ ...before, stream: null, fault: error.slug, isOpening: false }));
    }
  }, [size, chosen.camera, chosen.rate]);

  useEffect(() => {
    let isUnmounted = false;
    const isOn = running.current.stream !== null;
    if (isOn) turnOn();
    else if (!recordingFault()) isAllowed().then(yes => void (yes && !isUnmounted && turnOn()));
    return () => (isUnmounted = true);
  }, [turnOn]);
  useEffect(() => close, []);
  useEffect(() => {
    const refreshList = async () => {
      const list = await listCameras();
      setState(before => ({ ...before, list }));
    };
    navigator.mediaDevices?.addEventListener('devicechange', refreshList);
    return () => navigator.mediaDevices?.removeEventListener('devicechange', refreshList);
  }, []);

  const choose = more => {
    const next = { ...chosen, ...more };
    storeChoice(next);
    setChosen(next);
  };
  return { ...state, chosen: { ...chosen, size: size ?? '' }, choose, turnOn };
}

function loadChoice() {
  const defaults = { camera: '', rate: '30' };
  try {
    return { ...defaults, ...JSON.parse(localStorage.getItem(KEY) ?? '{}') };
  } catch {
    return defaults;
  }
}

function storeChoice({ camera, rate }) {
  try {
    localStorage.setItem(KEY, JSON.stringify({ camera, rate }));
  } catch {
    // Storage is refused: the person chooses again the next time.
  }
}
