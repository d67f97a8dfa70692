// The recording with its overlay and its controls.
import { html, useEffect, useRef, useState } from '../../preact.js';
import { clock } from '../../format.js';
import { t } from '../../texts.js';
import { icons } from '../page/icons.js';
import { drawOverlay } from './overlay.js';
import { markingKeys } from '../session/span_bar.js';

const words = t.session;
const RATES = [0.1, 0.25, 0.5, 1, 2, 4];
const LAYERS = ['tip', 'borders', 'mask', 'midline', 'path', 'depth'];
const SHOWN = { tip: true, borders: true, mask: true, midline: false, path: true, depth: true };

/**
 * Calls `onRead` with size and length of the recording, or with `false` if the browser cannot play it.
 *
 * @param {Props} props
 */
export function Player({ address, size, track, playback, hidden, onRead }) {
  const screen = useRef(null);
  const video = useRef(null);
  const canvas = useRef(null);
  const [show, setShow] = useState(SHOWN);
  const [unplayable, setUnplayable] = useState(false);

  useEffect(() => playback.attach(video.current), [address]);
  useEffect(() => playback.onShowInView(() => screen.current.scrollIntoView({ block: 'nearest' })), []);
  useEffect(() => {
    if (!track) return undefined;
    const draw = () => {
      if (!canvas.current) return;
      const shown = { width: video.current?.videoWidth ?? 0, height: video.current?.videoHeight ?? 0 };
      drawOverlay(canvas.current, track, playback.frame, { show, hidden, size, shown });
    };
    const resize = new ResizeObserver(draw);
    resize.observe(canvas.current);
    const unsubscribe = playback.onTick(draw);
    return () => (unsubscribe(), resize.disconnect());
  }, [track, show, hidden]);

  const showUnplayable = () => {
    setUnplayable(true);
    onRead(false);
    playback.withoutVideo(track?.duration ?? 0);
  };
  const showRead = () => {
    if (!video.current) return; // the page was left while the recording loaded
    const { videoWidth: width, videoHeight: height, duration } = video.current;
    onRead({ width, height, duration_s: duration * playback.factor });
  };
  // The height is reserved before the video is loaded, so that nothing below moves.
  const shape = size?.width ? `${size.width} / ${size.height}` : undefined;
  return html`
    <div ref=${screen} class="player">
      <div class="screen" style=${{ aspectRatio: shape }}>
        <video ref=${video} src=${address} preload="auto" playsinline muted aria-label=${words.video} onError=${showUnplayable}
          onLoadedMetadata=${showRead}
          onClick=${() => playback.toggle()}></video>
        <canvas ref=${canvas} aria-hidden="true"></canvas>
        ${unplayable && html`<p class="words" role="alert">${words.noVideo}${track && ` ${words.noVideoStill}`}</p>`}
      </div>
      ${(track || !unplayable) && html`<${Transport} playback=${playback} onFull=${() => (document.fullscreenElement ? document.exitFullscreen()
        : screen.current.requestFullscreen())}>
        ${track && html`
          <div class="row layers" role="group" aria-label=${words.overlay}>
            ${LAYERS.map(layer => html`<button key=${layer} type="button" class="button" aria-pressed=${show[layer]}
              onClick=${() => setShow({ ...show, [layer]: !show[layer] })}>${words.show[layer]}</button>`)}
          </div>`}
      <//>`}
    </div>`;
}

/** The controls alone: an imported session has no picture and can still be played. @param {Props} props */
export function Transport({ playback, onFull, children }) {
  const slider = useRef(null);
  const clockText = useRef(null);
  const [playing, setPlaying] = useState(false);
  const [rate, setRate] = useState(1);

  // Written straight to the elements: component state at 60 pictures a second would render the whole part each time.
  useEffect(
    () =>
      playback.onTick(({ time, frame, duration }) => {
        setPlaying(playback.playing);
        Object.assign(slider.current, { max: duration, value: time });
        slider.current.setAttribute('aria-valuetext', words.clock(clock(time), clock(duration)));
        clockText.current.textContent = `${words.clock(clock(time, 2), clock(duration, 2))} · ${words.frame(frame)}`;
      }),
    [],
  );
  const change = event => {
    setRate(Number(event.target.value));
    playback.setRate(Number(event.target.value));
  };
  const toggle = () => playback.toggle();
  return html`
    <div class="transport">
      <input ref=${slider} type="range" min="0" step="0.01" aria-label=${words.timeline}
        onInput=${event => playback.seek(Number(event.target.value))} onKeyDown=${sliderKeys(playback)} />
      <div class="row apart">
        <div class="row">
          <button class="button" type="button" aria-label=${words.back} title=${`${words.back} (,)`}
            onClick=${() => playback.step(-1)}><${icons.back} /></button>
          <button class="button main" type="button" aria-label=${playing ? words.pause : words.play} title=${playing
            ? words.pause : words.play} onClick=${toggle}><${playing ? icons.pause : icons.play} /></button>
          <button class="button" type="button" aria-label=${words.forward} title=${`${words.forward} (.)`}
            onClick=${() => playback.step(1)}><${icons.forward} /></button>
          <span ref=${clockText} class="clock"></span>
        </div>
        ${children}
        <div class="row">
          <select class="select" aria-label=${words.rate} value=${String(rate)} onChange=${change}>
            ${RATES.map(value => html`<option key=${value} value=${String(value)} selected=${value === rate}>
              ${words.rateOf(value)}</option>`)}
          </select>
          ${onFull && html`<button class="button" type="button" aria-label=${words.full} title=${words.full} onClick=${onFull}>
            <${icons.full} /></button>`}
        </div>
      </div>
    </div>`;
}

const KEY_SECONDS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };

/** The slider's own steps of a hundredth of a second are too small: arrow keys move by a second. */
function sliderKeys(playback) {
  return event => {
    if (!(event.key in KEY_SECONDS)) return;
    event.preventDefault();
    event.stopPropagation();
    playback.seek(playback.time + KEY_SECONDS[event.key]);
  };
}

/** Keys that work anywhere on the page, unless the focused element uses them itself. */
export function pageKeys(playback) {
  return event => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector('dialog[open]')) return;
    const at = event.target;
    if (at.closest?.('input:not([type="range"]), select, textarea')) return;
    const onControl = at.closest?.('button, a, summary');
    const actions = {
      ...markingKeys(playback),
      ',': () => playback.step(-1),
      '.': () => playback.step(1),
      ArrowLeft: () => playback.seek(playback.time - 1),
      ArrowRight: () => playback.seek(playback.time + 1),
    };
    if (event.key === ' ' && !onControl) actions[' '] = () => playback.toggle();
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  };
}
