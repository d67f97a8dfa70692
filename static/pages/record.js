// Record: uses this device's camera as the camera of a box. The recording runs in record/recorder.js and continues
// after this page is left.
import { html, useEffect, useRef, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem, useData } from '../data.js';
import { t } from '../texts.js';
import { Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { CameraFields, CameraNotices } from '../parts/recording/record_camera.js';
import { InterruptedRecordings } from '../parts/recording/interrupted_recordings.js';
import { RecordNotices } from '../parts/recording/record_notices.js';
import { RecordView } from '../parts/recording/record_view.js';
import { RecordingStatus } from '../parts/recording/recording_status.js';
import { maySendRecordings, RecordingTargetFields, TargetNeeded, useRecordingTarget } from '../parts/recording/recording_target.js';
import { useCamera } from '../parts/recording/use_camera.js';
import { href } from '../router.js';
import { useLiveWatch } from '../watch.js';
import { currentRecording, isRecording, onRecording } from '../record/current_recording.js';
import { startRecording, stopRecording } from '../record/recorder.js';

const words = t.record;
const DEFAULT_SIZE = '1920x1080';
/** A second click within this time hits a button that has just changed its meaning, and is ignored. */
const DOUBLE_CLICK_MS = 1000;

/** @param {Props} props */
export default function RecordPage({ person, route }) {
  if (!maySendRecordings(person))
    return html`<${PageHead} title=${words.title} /><${Notice} tone="warn" title=${t.target.noTrainee} />`;
  const exam = route.query.get('exam');
  return exam ? html`<${ExamRecorder} key=${exam} id=${exam} person=${person} route=${route} />` : html`<${Recorder} person=${person} route=${route} />`;
}

/** Records an attempt of an exam: candidate, task and box are fixed. @param {Props} props */
function ExamRecorder({ id, person, route }) {
  const { data: exam, problem, reload } = useData(signal => api.exams.get(id, signal), [id]);
  if (!exam)
    return html`<${PageHead} title=${words.title} />${problem ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const { trainee, task, box } = exam;
  const ids = { trainee: trainee.id, task: task.id, box: box.id };
  const fixed = new URLSearchParams(ids);
  return html`<${Recorder} person=${person} route=${{ ...route, query: fixed }} exam=${exam} />`;
}

/** @param {{ person: Props['person'], route: Props['route'], exam?: Props['exam'] }} props */
function Recorder({ person, route, exam }) {
  const target = useRecordingTarget({ person, route });
  const recording = useRecording();
  const box = target.chosen.box;
  const isTargetLoaded = Boolean(target.lists || target.problem);
  const { data: calibrated } = useData(async () => {
    if (!isTargetLoaded) return undefined;
    return box?.calibration ? api.boxes.camera(box.id).catch(() => null) : null;
  }, [isTargetLoaded, box?.id]);
  // A person who comes back sees the size that is being recorded.
  const [runningPicture] = useState(() => (isRecording() ? currentRecording?.picture : null));
  const camera = useCamera(wantedSize(runningPicture ?? calibrated));
  const [problem, setProblem] = useState(null);
  const [startRefused, setStartRefused] = useState(false);
  const [isStarting, setStarting] = useState(false);
  const startedAt = useRef(-Infinity);
  const start = async () => {
    setStartRefused(!target.ids);
    const { stream } = camera;
    if (!target.ids || !stream) return;
    setProblem(null);
    setStarting(true);
    startedAt.current = performance.now();
    const { ids, names } = target;
    const begin = async () => {
      const ordered = exam && (await api.exams.record(exam.id, { way: 'browser' }));
      await startRecording(stream, { target: ids, names, recording: ordered?.recording, exam: exam?.id });
    };
    await begin().catch(error => setProblem(asProblem(error)));
    setStarting(false);
  };
  const press = () => {
    if (isStarting || performance.now() - startedAt.current < DOUBLE_CLICK_MS) return;
    if (recording?.phase === 'recording') stopRecording();
    else start();
  };
  const isBusy = isRecording();
  // Without pictures: this page shows its own camera's.
  // The candidate of an exam, who may stand before this screen, sees no live figures.
  const watch = useLiveWatch(isBusy && !recording?.exam ? recording?.session : null, null, false);
  useEffect(() => void (recording?.connection === 'open' && watch?.retry()), [recording?.connection, watch]);
  return html`
    <${PageHead} title=${words.title} lead=${isBusy ? recording?.names : words.lead} />
    <div class="stack">
      <${ProblemNotice} problem=${target.problem} onRetry=${target.reload} />
      ${exam && html`<${Notice} tone="busy" title=${t.exams.of(exam.trainee.name, exam.task.name)}>${t.exams.recordBody}
        <span class="row after"><a class="button" href=${href(['exams', exam.id])}>${t.exams.back}</a></span><//>`}
      <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
      <div class="record">
        <div class="stack">
          <${RecordView} recording=${recording} camera=${camera} watch=${watch}
            isReady=${camera.stream && target.lists && !isStarting} onPress=${press} />
          ${startRefused && !target.ids && html`<${TargetNeeded} refused=${target.refused} />`}
        </div>
        <div class="stack">
          <${RecordNotices} recording=${recording} />
          ${!isBusy && html`<${InterruptedRecordings} />`}
          ${isBusy && html`<${RecordingStatus} recording=${recording} watch=${watch} />`}
          ${!isBusy && html`<${Setup} isFixed=${Boolean(exam)} target=${target} camera=${camera} calibrated=${calibrated} box=${box}
            person=${person} />`}
        </div>
      </div>
    </div>`;
}

/**
 * The size of what is recorded, else of the box's calibration, else the default; undefined until the calibration is
 * loaded.
 */
function wantedSize(picture) {
  if (picture === undefined) return undefined;
  return picture ? `${picture.width}x${picture.height}` : DEFAULT_SIZE;
}

/** @param {Props} props */
function Setup({ target, isFixed, camera, calibrated, box, person }) {
  return html`
    <section class="card">
      <header><h2>${words.setup}</h2></header>
      <div class="body stack">
        ${!target.lists && !target.problem && html`<${Loading} />`}
        <div class="fields">
          ${target.lists && !isFixed && html`<${RecordingTargetFields} target=${target} />`}
          <${CameraFields} camera=${camera} calibrated=${calibrated} />
        </div>
        <${CameraNotices} camera=${camera} calibrated=${calibrated} box=${box} person=${person} />
      </div>
    </section>`;
}

function useRecording() {
  const [recording, setRecording] = useState(currentRecording);
  useEffect(() => onRecording(() => setRecording(currentRecording)), []);
  return recording;
}
