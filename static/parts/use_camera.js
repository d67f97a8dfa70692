// The camera of this device while a page is there: opened when it may be, anew when another one or another picture is
// chosen, closed with the page. Camera and rate are remembered in this browser; the picture is the box's business.
import { useCallback, useEffect, useRef, useState } from './preact.js';
import { CameraFault, cameras, fault, isAllowed, open } from '../record/camera.js';

const KEY = 'trocar.camera';

/**
 * `stream` or null, `fault` (a slug) or null, `isOpening`, `list` of cameras, `chosen` `{ camera, size, rate }`,
 * `choose(more)` and `turnOn()`. `wanted` is the picture where none was chosen, as `1280x720`; the camera waits until it is
 * known.
 */
export function useCamera(wanted) {
  const [chosen, setChosen] = useState(remembered);
  const [state, setState] = useState({ stream: null, fault: fault()?.slug ?? null, isOpening: false, list: [] });
  const running = useRef({ stream: null, turn: 0 });
  const size = chosen.size || wanted;

  const close = () => {
    running.current.turn++;
    running.current.stream?.getTracks().forEach(track => track.stop());
    running.current.stream = null;
  };
  const turnOn = useCallback(async () => {
    if (fault() || !size) return;
    close();
    const turn = running.current.turn;
    const isOld = () => turn !== running.current.turn;
    setState(before => ({ ...before, stream: null, fault: null, isOpening: true }));
    const [width, height] = size.split('x').map(Number);
    try {
      const stream = await open({ camera: chosen.camera, width, height, rate: Number(chosen.rate) });
      if (isOld()) return stream.getTracks().forEach(track => track.stop());
      running.current.stream = stream;
      const gone = () => !isOld() && setState(before => ({ ...before, stream: null, fault: 'gone' }));
      stream.getVideoTracks()[0].onended = gone;
      setState({ stream, fault: null, isOpening: false, list: await cameras() });
    } catch (error) {
      if (!(error instanceof CameraFault)) throw error;
      if (!isOld()) setState(before => ({ ...before, stream: null, fault: error.slug, isOpening: false }));
    }
  }, [size, chosen.camera, chosen.rate]);

  useEffect(() => {
    let stale = false;
    const isOn = running.current.stream !== null;
    if (isOn) turnOn();
    else if (!fault()) isAllowed().then(yes => yes && !stale && turnOn());
    return () => (stale = true);
  }, [turnOn]);
  useEffect(() => close, []);
  useEffect(() => {
    const look = async () => {
      const list = await cameras();
      setState(before => ({ ...before, list }));
    };
    navigator.mediaDevices?.addEventListener('devicechange', look);
    return () => navigator.mediaDevices?.removeEventListener('devicechange', look);
  }, []);

  const choose = more => {
    const next = { ...chosen, ...more };
    remember(next);
    setChosen(next);
  };
  return { ...state, chosen: { ...chosen, size: size ?? '' }, choose, turnOn };
}

function remembered() {
  const usual = { camera: '', rate: '30' };
  try {
    return { ...usual, ...JSON.parse(localStorage.getItem(KEY)) };
  } catch {
    return usual;
  }
}

function remember({ camera, rate }) {
  try {
    localStorage.setItem(KEY, JSON.stringify({ camera, rate }));
  } catch {
    // Storage is refused: it is chosen again the next time.
  }
}
