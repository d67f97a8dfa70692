// The marked span: its start and end, and a loop over it. Everything about a stretch of the recording uses it.
import { html, useEffect, useState } from '../../preact.js';
import { clock } from '../../format.js';
import { t } from '../../texts.js';

const words = t.session.marking;

/** The marked span of a playback, kept up to date: `[from, to]` in seconds, or null; and whether it loops. */
export function useMarked(playback) {
  const [state, setState] = useState({ marked: playback.marked, looping: playback.looping });
  useEffect(
    () =>
      playback.onTick(({ marked, looping }) =>
        setState(before => (before.marked === marked && before.looping === looping ? before : { marked, looping })),
      ),
    [playback],
  );
  return state;
}

export const spanName = ([from, to]) => `${clock(from, 2)}–${clock(to, 2)}`;

/** @param {Props} props */
export function SpanBar({ playback }) {
  const { marked, looping } = useMarked(playback);
  return html`
    <div class="row marking" role="group" aria-label=${words.title}>
      <button class="button" type="button" title=${`${words.from} ([)`}
        onClick=${() => playback.mark(playback.time, keptEnd(playback, marked))}>${words.from}</button>
      <button class="button" type="button" title=${`${words.to} (])`}
        onClick=${() => playback.mark(keptStart(playback, marked), playback.time)}>${words.to}</button>
      <span class="clock" role="status">${marked ? spanName(marked) : words.none}</span>
      ${marked && html`
        <button class="button" type="button" aria-pressed=${looping} title=${`${words.loop} (l)`}
          onClick=${() => playback.loop(!looping)}>${words.loop}</button>
        <button class="button" type="button" onClick=${() => playback.mark(0, 0)}>${words.clear}</button>`}
    </div>`;
}

/** The end that stays when the start moves, and the start that stays when the end moves. */
const keptEnd = ({ time, duration }, marked) => (marked && marked[1] > time ? marked[1] : duration);
const keptStart = ({ time }, marked) => (marked && marked[0] < time ? marked[0] : 0);

/** The keys `[`, `]` and `l` do the same as the buttons. */
export const markingKeys = playback => ({
  '[': () => playback.mark(playback.time, keptEnd(playback, playback.marked)),
  ']': () => playback.mark(keptStart(playback, playback.marked), playback.time),
  l: () => playback.loop(!playback.looping),
});
