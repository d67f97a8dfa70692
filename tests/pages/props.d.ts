// The types of the components' properties. A template does not pass types on, so one name has one type on every page.

import type { Playback } from '../../static/parts/playback/playback.js';
import type { LiveWatch } from '../../static/watch.js';

declare global {
  interface Props {
    agreement: Schemas['Agreement'];
    box: Schemas['BoxResponse'] & BoxParts;
    calibrations: Schemas['CalibrationResponse'][];
    calibration: Schemas['BoxResponse']['calibration'];
    certificate: Schemas['CertificateResponse'];
    certificates: Schemas['CertificateResponse'][];
    charts: NonNullable<Schemas['TraineeProgressResponse']['charts']>;
    correlations: Schemas['Correlations'];
    distribution: Schemas['Distribution'];
    edit: Schemas['EditResponse'];
    edits: Schemas['EditsResponse'];
    exam: Schemas['ExamDetails'];
    exams: Schemas['ExamResponse'][];
    evidence: Schemas['EvidenceResponse'] | null | undefined;
    feature: Schemas['FeatureResponse'];
    form: Schemas['FormInfo'];
    given: Schemas['RatingResponse'][];
    group: Schemas['GroupResponse'];
    person: Schemas['Me'];
    plans: Schemas['CoursePlan'][];
    playback: Playback;
    progress: Schemas['TraineeProgressResponse'];
    quality: NonNullable<Schemas['SessionResponse']['quality']>;
    ratings: Schemas['RatingsResponse'];
    route: { path: string[]; query: URLSearchParams; params: Record<string, string> };
    session: Schemas['SessionResponse'];
    sheet: Schemas['ErrorSheetResponse'];
    sheets: Schemas['ErrorSheetResponse'][];
    sessions: Schemas['TraineeProgressResponse']['sessions'];
    standard: Schemas['StandardResponse'];
    standards: Schemas['StandardResponse'][];
    targets: Schemas['StandardResponse']['targets'];
    task: Schemas['TaskResponse'];
    tasks: Schemas['TaskResponse'][];
    test: Schemas['SelfTestResponse'];
    tests: Schemas['SelfTestResponse'][];
    verdict: Schemas['SessionResponse']['verdict'];
    watch: LiveWatch & { track: NonNullable<LiveWatch['track']> };
    [other: string]: any;
  }

  /** What the pages of one box load with it. */
  interface BoxParts {
    camera?: any;
    palettes: Schemas['PaletteResponse'][];
    calibrations: Schemas['CalibrationResponse'][];
    selfTests: Schemas['SelfTestResponse'][];
    tokens: Schemas['TokenResponse'][];
  }

  /** The progress of a trainee who has passed. */
  type PassedProgress = Present<Schemas['TraineeProgressResponse'], 'passed' | 'rule' | 'standard' | 'task'>;

  /** `T` with the members `K`, which may be missing in `T`. */
  type Present<T, K extends keyof T> = T & { [M in K]-?: NonNullable<T[M]> };
}
