// Record: this device's own camera as the camera of a box. The recording itself lives in record/recorder.js and outlasts
// this page.
import { html, useEffect, useRef, useState } from '../parts/preact.js';
import { api } from '../api.js';
import { asProblem, useData } from '../data.js';
import { t } from '../texts.js';
import { Loading, Notice, PageHead, ProblemNotice } from '../parts/notice.js';
import { CameraFields, CameraNotices } from '../parts/record_camera.js';
import { RecordNews } from '../parts/record_news.js';
import { RecordView } from '../parts/record_view.js';
import { Standing } from '../parts/standing.js';
import { maySend, Need, TargetFields, useTarget } from '../parts/target.js';
import { useCamera } from '../parts/use_camera.js';
import { useWatch } from '../watch.js';
import { isRecording, now as recording, onRecording } from '../record/current.js';
import { begin, stop } from '../record/recorder.js';

const words = t.record;
const USUAL = '1920x1080';
/** A second click on the button that has just changed its meaning. */
const TWICE_MS = 1000;

export default function RecordPage({ person, route }) {
  if (!maySend(person))
    return html`<${PageHead} title=${words.title} /><${Notice} tone="warn" title=${t.target.noTrainee} />`;
  return html`<${Recorder} person=${person} route=${route} />`;
}

function Recorder({ person, route }) {
  const target = useTarget({ person, route });
  const now = useRecording();
  const box = target.chosen.box;
  const isKnown = Boolean(target.lists || target.problem);
  const { data: calibrated } = useData(async () => {
    if (!isKnown) return undefined;
    return box?.calibration ? api.boxes.camera(box.id).catch(() => null) : null;
  }, [isKnown, box?.id]);
  const [runs] = useState(() => (isRecording() ? recording.picture : null)); // Whoever comes back sees what is recorded.
  const camera = useCamera(sizeOf(runs ?? calibrated));
  const [problem, setProblem] = useState(null);
  const [heldUp, setHeldUp] = useState(false);
  const [isBeginning, setBeginning] = useState(false);
  const begunAt = useRef(-Infinity);
  const start = async () => {
    setHeldUp(!target.ids);
    if (!target.ids || !camera.stream) return;
    setProblem(null);
    setBeginning(true);
    begunAt.current = performance.now();
    const { ids, names } = target;
    await begin(camera.stream, { target: ids, names }).catch(error => setProblem(asProblem(error)));
    setBeginning(false);
  };
  const press = () => {
    if (isBeginning || performance.now() - begunAt.current < TWICE_MS) return;
    if (now?.phase === 'recording') stop();
    else start();
  };
  const isBusy = isRecording();
  const watch = useWatch(isBusy ? now.session : null, null, false); // The picture is here already.
  useEffect(() => void (now?.line === 'open' && watch?.retry()), [now?.line, watch]);
  return html`
    <${PageHead} title=${words.title} lead=${isBusy ? now.names : words.lead} />
    <div class="stack">
      <${ProblemNotice} problem=${target.problem} onRetry=${target.reload} />
      <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
      <div class="record">
        <div class="stack">
          <${RecordView} now=${now} camera=${camera} watch=${watch}
            isReady=${camera.stream && target.lists && !isBeginning} onPress=${press} />
          ${heldUp && !target.ids && html`<${Need} />`}
        </div>
        <div class="stack">
          <${RecordNews} now=${now} />
          ${isBusy && html`<${Standing} now=${now} watch=${watch} />`}
          ${!isBusy && html`<${Setup} target=${target} camera=${camera} calibrated=${calibrated} box=${box}
            person=${person} />`}
        </div>
      </div>
    </div>`;
}

/** The picture that is wanted: what is recorded, or what the box is calibrated for; not known before that is. */
function sizeOf(picture) {
  if (picture === undefined) return undefined;
  return picture ? `${picture.width}x${picture.height}` : USUAL;
}

function Setup({ target, camera, calibrated, box, person }) {
  return html`
    <section class="card">
      <header><h2>${words.setup}</h2></header>
      <div class="body stack">
        ${!target.lists && !target.problem && html`<${Loading} />`}
        <div class="fields">
          ${target.lists && html`<${TargetFields} target=${target} />`}
          <${CameraFields} camera=${camera} calibrated=${calibrated} />
        </div>
        <${CameraNotices} camera=${camera} calibrated=${calibrated} box=${box} person=${person} />
      </div>
    </section>`;
}

function useRecording() {
  const [now, setNow] = useState(recording);
  useEffect(() => onRecording(() => setNow(recording)), []);
  return now;
}
