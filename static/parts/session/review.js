// The review of a recording: video, curves, path in space, features and quality, all on one clock.
import { html, useEffect, useMemo, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { bytes, clock, date } from '../../format.js';
import { setAddressSilently } from '../../router.js';
import { t } from '../../texts.js';
import { Advice } from './advice.js';
import { Comments } from './comments.js';
import { Edits } from './edits.js';
import { ReviewedErrors } from './error_sheets.js';
import { Features } from './features.js';
import { GhostChooser, useGhost } from './ghost.js';
import { Notice } from '../page/notice.js';
import { ChunkLoader } from '../playback/chunk_loader.js';
import { Path3d } from '../playback/path3d.js';
import { useCohortPlaces } from './cohort_places.js';
import { Playback } from '../playback/playback.js';
import { pageKeys, Player, Transport } from '../playback/player.js';
import { Plots } from '../playback/plots.js';
import { Quality } from './quality.js';
import { Ratings } from './ratings.js';
import { Readouts, ToolSwitches } from '../playback/readouts.js';
import { evidenceByFeature } from './evidence.js';
import { usedVersionText } from './setup_versions.js';
import { SpanBar } from './span_bar.js';
import { buildTrack } from '../playback/track.js';

const words = t.session;
const SPANS = ['all', '20', '5'];
const FORMATS = ['csv', 'json', 'parquet'];
/** Exact rows are requested this long before they are played, s. */
const AHEAD_S = 10;

/** @param {Props} props */
export function Review({ session, person, trajectory, edits, start, onEdited }) {
  const playback = useMemo(() => new Playback(), []);
  const { track, loader } = useTrack(session, trajectory, playback);
  const { ghost, chooser } = useGhost(session, track);
  const tools = trajectory?.tools ?? session.tools ?? [];
  const [hidden, setHidden] = useState(new Set());
  const [rated, setRated] = useState(0);
  const { evidence, advice } = useEvidence(session);
  const [span, setSpan] = useState('all');
  /** What the browser knows of the recording: `null` until it has read its beginning, `false` if it cannot play it. */
  const [played, setPlayed] = useState(null);

  useEffect(() => {
    const keys = pageKeys(playback);
    document.addEventListener('keydown', keys);
    return () => (document.removeEventListener('keydown', keys), playback.pause());
  }, []);
  playback.setClock(session.video?.clock ?? {});
  useEffect(() => seekWhenReady(playback, start), [start]);
  useEffect(() => keepTimeInAddress(playback, session.id), []);

  const toggle = name =>
    setHidden(before => new Set(before.has(name) ? [...before].filter(other => other !== name) : [...before, name]));
  return html`
    <div class="review">
      <div class="stack">
        <section class="card first">
          ${!hasVideo(session) ? html`<div class="body"><${Notice} title=${words.noRecording}>${session.video?.deleted_at
            ? words.videoDeleted(date(session.video.deleted_at)) : words.noRecordingBody(session.source.tracker)}<//></div>${track && html`<${Transport} playback=${playback} />`}` : html`<${Player} address=${api.sessions.videoAddress(session.id)} size=${session.video} track=${track}
            playback=${playback} hidden=${hidden} onRead=${setPlayed} />`}
          ${track && html`<${Readouts} track=${track} playback=${playback} />`}
          ${(track || played !== false) && html`<p class="small muted keys">${words.keys}</p>`}
        </section>
        <${ReviewedErrors} session=${session} person=${person} playback=${playback} />
        ${track && html`<${Card} title=${words.space} place="third"><${Path3d} track=${track} playback=${playback}
          hidden=${hidden} ghost=${ghost} /><//>`}
        <div class="said-of stack">
          <${Comments} session=${session} playback=${playback} rated=${rated} />
          <${Ratings} session=${session} person=${person} onRated=${() => setRated(rated + 1)} />
        </div>
        <div class="pair">
          ${session.quality?.tools && html`<${Card} title=${words.quality}><${Quality}
            quality=${session.quality} /><//>`}
          <${Card} title=${words.versions}><${SessionVersions} session=${session} played=${played} /><//>
        </div>
      </div>
      <div class="stack">
        ${track && html`
          <section class="card second">
            <header>
              <h2>${words.curves}</h2>
              <div class="row">
                <${ToolSwitches} track=${track} hidden=${hidden} onToggle=${toggle} />
                <${SpanChoice} span=${span} onChange=${setSpan} />
              </div>
            </header>
            <${Plots} track=${track} playback=${playback} hidden=${hidden} span=${span === 'all' ? 0 : Number(span)}
              kept=${edits?.kept} ghost=${ghost} loader=${loader} />
            <div class="under-curves"><${SpanBar} playback=${playback} /><${GhostChooser} chooser=${chooser} /></div>
            <p class="small muted keys">${words.curvesHint}</p>
          </section>`}
        ${advice && html`<div class="advised"><${Advice} advice=${advice} playback=${playback} /></div>`}
        ${session.status === 'done' && html`<section class="card fourth"><header><h2>${words.features}</h2></header>
          ${evidence?.features === null && html`<p class="small muted chooser">${words.evidence.notKept}</p>`}
          <${MeasuredFeatures} session=${session} evidence=${evidence?.map} playback=${playback} /></section>`}
        <${Edits} session=${session} person=${person} edits=${edits} playback=${playback} tools=${tools} onEdited=${onEdited} />
      </div>
    </div>`;
}

/**
 * The features with their places. A component of its own: places that arrive late change this table alone.
 *
 * @param {Props} props
 */
const MeasuredFeatures = ({ session, evidence, playback }) => html`
  <${Features} session=${session} places=${useCohortPlaces(session)} evidence=${evidence} playback=${playback} />`;

/** The evidence of the features, and what to work on next; the page works without either. */
function useEvidence(session) {
  const load = async signal => {
    if (session.status !== 'done') return {};
    const [evidence, advice] = await Promise.all([
      api.sessions.evidence(session.id, signal).catch(() => null),
      api.sessions.advice(session.id, signal).catch(() => null),
    ]);
    return { evidence: evidence && { ...evidence, map: evidenceByFeature(evidence.features) }, advice };
  };
  return useData(load, [session.id, session.status, session.result]).data ?? {};
}

/** The track of a trajectory, set on the playback's clock, and the loader of its exact rows. */
function useTrack(session, trajectory, playback) {
  const isRecording = hasVideo(session);
  const track = useMemo(
    () =>
      trajectory?.columns.frame.length
        ? buildTrack(trajectory, session.video?.frames ?? session.quality?.frames, session.video ?? {})
        : null,
    [trajectory],
  );
  const loader = useMemo(() => track && new ChunkLoader(session.id, track, isRecording), [track]);
  useEffect(() => {
    playback.times = track?.times ?? null;
    // Without a video the clock runs by itself.
    if (track && !isRecording) playback.withoutVideo(track.duration);
    playback.seek(playback.time);
    if (!loader) return undefined;
    const cleanups = [
      loader.onChunk(() => playback.refresh()),
      playback.onTick(({ time, playing, rate }) => loader.request(time, time + (playing ? AHEAD_S * Math.max(1, rate) : 0))),
    ];
    return () => (cleanups.forEach(unsubscribe => unsubscribe()), loader.end());
  }, [track]);
  return { track, loader };
}

/** False for an imported path, and once the centre no longer keeps the video. @param {Schemas['SessionResponse']} session */
const hasVideo = session => session.source?.kind !== 'import' && !session.video?.deleted_at;

const SpanChoice = ({ span, onChange }) => html`
  <select class="select" aria-label=${words.span} value=${span} onChange=${event => onChange(event.target.value)}>
    ${SPANS.map(key => html`<option key=${key} value=${key} selected=${key === span}>${words.spans[key]}</option>`)}
  </select>`;

const Card = ({ title, place = '', children }) =>
  html`<section class=${`card ${place}`}><header><h2>${title}</h2></header><div class="body">
    ${children}</div></section>`;

/** A deep link's `?t=`: goes there as soon as the recording can. */
function seekWhenReady(playback, seconds) {
  if (!seconds) return undefined;
  const unsubscribe = playback.onTick(({ duration }) => {
    if (duration < seconds) return;
    queueMicrotask(() => (unsubscribe?.(), playback.seek(seconds)));
  });
  return unsubscribe;
}

/** When playback has rested this long, the address gets the time, so that a copied link leads to the same picture. */
const ADDRESS_DELAY_MS = 500;

function keepTimeInAddress(playback, id) {
  let timer;
  const unsubscribe = playback.onTick(({ time, playing }) => {
    clearTimeout(timer);
    if (!playing && time > 0) timer = setTimeout(() => setAddressSilently(['sessions', id], { t: time.toFixed(2) }), ADDRESS_DELAY_MS);
  });
  return () => (unsubscribe(), clearTimeout(timer));
}

/** Ids are long; their ends are enough to distinguish them. The title and the REST API have the whole id. */
const short = version => (/^[0-9a-f-]{20,}$/.test(version) ? `…${version.slice(-8)}` : (version ?? words.noneYet));

/** @param {Props} props */
function SessionVersions({ session, played }) {
  const { video, versions, setup } = session;
  // A recording that was not scored has no facts of the service; the browser may have some.
  const { width, height, duration_s: duration } = video?.width ? video : { ...video, ...played };
  return html`
    <div class="stack">
      <dl class="facts">
        ${video && html`${width > 0 && html`<dt>${words.size}</dt><dd>
          ${width} × ${height}${Number.isFinite(video.frames) && `, ${words.frames(video.frames)}`}</dd>`}
          ${Number.isFinite(duration) && html`<dt>${words.length}</dt><dd>${clock(duration)}</dd>`}
          ${Number.isFinite(video.bytes) && html`<dt>${words.file}</dt><dd>${bytes(video.bytes)}</dd>`}`}
        ${Object.entries(words.version).filter(([key]) => key !== 'tracked_with' || versions?.tracked_with).map(([key, name]) => html`<dt key=${key}>${name}</dt>
          ${setup?.[key] ? html`<dd title=${versions?.[key]}>${usedVersionText(setup[key])}</dd>`
            : html`<dd class="code" title=${versions?.[key]}>${short(versions?.[key])}</dd>`}`)}
      </dl>
      ${session.status === 'done' && html`
        <div class="downloads">
          <span class="label">${words.download}</span>
          <div class="row">${FORMATS.map(format => html`<a key=${format} class="button" download
            href=${api.sessions.trajectoryAddress(session.id, format)}>${words.formats[format]}</a>`)}</div>
        </div>
        <div class="downloads">
          <span class="label">${words.downloadFeatures}</span>
          <div class="row">${FORMATS.map(format => html`<a key=${format} class="button" download
            href=${api.sessions.featuresAddress(session.id, format)}>${words.formats[format]}</a>`)}</div>
        </div>`}
    </div>`;
}
