// Whether camera and ports are where they were in earlier recordings. The service judges it, as for the whole
// recording.
import { fixed } from '../../format.js';
import { t } from '../../texts.js';

const words = t.watch.placement;

/** What has moved, in words; null if nothing has, or if it is not known. */
export function placementFault(placement, tools) {
  if (!placement) return null;
  if (placement.camera) return { title: words.camera(fixed(placement.camera.mm, 0)), advice: words.cameraAdvice };
  const moved = placement.ports.map((shift, index) => shift && words.port(tools[index]?.name, fixed(shift.mm, 0)));
  const faults = moved.filter(Boolean);
  return faults.length ? { title: faults.join(', '), advice: words.portAdvice } : null;
}
