// A ghost: another session of the same trainee and task, drawn pale under this one and in time with it: the best, or a
// chosen one.
import { html, useEffect, useMemo, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { dateTime, number, unit } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { featureTitle } from '../../translate.js';
import { buildTrack, firstSeen } from '../playback/track.js';

const words = t.session.ghost;
/** Rows per tool: a path that lies under another need not be finer. */
const POINTS = 3000;

/** The other sessions that can be compared, newest first, and the best of them by the first feature. */
function othersOf(progress, session) {
  const series = progress?.features[0];
  // A lower bound is no value to compare.
  const valueOf = at => series?.points.find(point => point.session === at && !point.is_lower_bound)?.value ?? null;
  const others = (progress?.sessions ?? [])
    .filter(one => one.id !== session.id && one.status === 'done')
    .map(one => ({ ...one, value: valueOf(one.number) }))
    .reverse();
  const sign = { lower: 1, higher: -1 }[series?.better];
  const counted = others.filter(one => !one.set_aside && one.value !== null);
  const best = sign && counted.length ? counted.reduce((a, b) => (sign * b.value < sign * a.value ? b : a)) : null;
  return { series, others, best };
}

/** `{ chooser, ghost }`: `ghost` is `{ track, shift, session }` once another session is chosen and loaded. */
export function useGhost(session, track) {
  const [id, setId] = useState('');
  const { data: progress } = useData(
    signal => (track && session.trainee ? api.trainees.progress(session.trainee.id, { task: session.task.id }, signal) : null),
    [session.id, Boolean(track)],
  );
  const candidates = useMemo(() => othersOf(progress, session), [progress]);
  const [rows, setRows] = useState(null);
  useEffect(() => {
    if (!id) return void setRows(null);
    const controller = new AbortController();
    api.sessions.trajectory(id, { points: POINTS }, controller.signal).then(
      path => setRows({ id, path }),
      error => error.name !== 'AbortError' && setRows({ id, problem: error }),
    );
    return () => controller.abort();
  }, [id]);
  const ghost = useMemo(() => {
    if (!track || !rows?.path?.columns.frame.length || rows.id !== id) return null;
    const other = buildTrack(rows.path);
    return { track: other, shift: firstSeen(other) - firstSeen(track), session: candidates.others.find(one => one.id === id) };
  }, [rows, track, id]);
  return { ghost, chooser: { ...candidates, id, setId, problem: rows?.problem, isLoading: Boolean(id) && rows?.id !== id } };
}

export function GhostChooser({ chooser: { series, others, best, id, setId, problem, isLoading } }) {
  if (!others.length) return null;
  const chosen = others.find(one => one.id === id);
  const valueOf = one => (one.value === null ? '' : ` · ${featureTitle(series)} ${number(one.value)} ${unit(series.unit)}`.trimEnd());
  const nameOf = one => `${words.session(one.number)}, ${dateTime(one.recorded_at)}${valueOf(one)}`;
  return html`
    <div class="row ghosts">
      <label class="row small">${words.label}
        <select class="select" value=${id} onChange=${event => setId(event.target.value)}>
          <option value="" selected=${!id}>${words.nobody}</option>
          ${best && html`<option value=${best.id} selected=${id === best.id}>${words.best} – ${nameOf(best)}</option>`}
          ${others.filter(one => one !== best).map(one => html`<option key=${one.id} value=${one.id} selected=${id === one.id}>${
            nameOf(one)}</option>`)}
        </select></label>
      <span class="small muted" role="status">
        ${isLoading && t.loading}
        ${problem && words.failed}
        ${chosen && !isLoading && !problem && html`${words.pale} <a href=${href(['sessions', chosen.id])}>${
          words.session(chosen.number)}, ${dateTime(chosen.recorded_at)}</a>${chosen === best && ` (${words.best})`}`}
      </span>
    </div>`;
}
