// The marked span: where it begins and ends, a loop over it. Everything that is about a stretch of the recording takes it.
import { html, useEffect, useState } from './preact.js';
import { clock } from '../format.js';
import { t } from '../texts.js';

const words = t.session.marking;

/** The marked span of a playback, kept up to date: `[from, to]` in seconds, or null. */
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

export function SpanBar({ playback }) {
  const { marked, looping } = useMarked(playback);
  return html`
    <div class="row marking" role="group" aria-label=${words.title}>
      <button class="button" type="button" title=${`${words.from} ([)`}
        onClick=${() => playback.mark(playback.time, laterThan(playback, marked))}>${words.from}</button>
      <button class="button" type="button" title=${`${words.to} (])`}
        onClick=${() => playback.mark(earlierThan(playback, marked), playback.time)}>${words.to}</button>
      <span class="clock" role="status">${marked ? spanName(marked) : words.none}</span>
      ${marked && html`
        <button class="button" type="button" aria-pressed=${looping} title=${`${words.loop} (l)`}
          onClick=${() => playback.loop(!looping)}>${words.loop}</button>
        <button class="button" type="button" onClick=${() => playback.mark(0, 0)}>${words.clear}</button>`}
    </div>`;
}

/** The end that stays when the beginning moves, and the beginning that stays when the end does. */
const laterThan = ({ time, duration }, marked) => (marked && marked[1] > time ? marked[1] : duration);
const earlierThan = ({ time }, marked) => (marked && marked[0] < time ? marked[0] : 0);

/** The keys `[`, `]` and `l`, as the buttons. */
export const markingKeys = playback => ({
  '[': () => playback.mark(playback.time, laterThan(playback, playback.marked)),
  ']': () => playback.mark(earlierThan(playback, playback.marked), playback.time),
  l: () => playback.loop(!playback.looping),
});
