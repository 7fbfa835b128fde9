// The torque-angle loop of one frequency and amplitude of a stepped sine, chosen by hand.
//
// The page has no list of steps. The angle around a sample tells its step: of the frequencies that were measured, the
// one at which it moves most, with the amplitude of that motion.

const PERIODS_AROUND = 2;  // of the motion, which are enough to tell neighbouring frequencies apart
const AMPLITUDE_SHARE = 0.1;  // by which the amplitude of a sample may differ from that of its step

// sums[j] - sums[i] is the sum of the values from i to j - 1
function runningSums(values) {
  const sums = new Float64Array(values.length + 1);
  values.forEach((value, k) => { sums[k + 1] = sums[k] + (Number.isFinite(value) ? value : 0); });
  return sums;
}

// amplitude of a signal at a frequency, within PERIODS_AROUND periods around each sample; 0 near the ends
function amplitudesAround(time, signal, frequency_hz) {
  const rate_hz = (time.length - 1) / (time[time.length - 1] - time[0]);
  const half = Math.round((PERIODS_AROUND * rate_hz) / frequency_hz / 2);
  const angle = (k) => 2 * Math.PI * frequency_hz * time[k];
  const real = runningSums(signal.map((value, k) => value * Math.cos(angle(k))));
  const imaginary = runningSums(signal.map((value, k) => value * Math.sin(angle(k))));
  return time.map((_, k) => {
    const [from, to] = [k - half, k + half];
    if (from < 0 || to > time.length) return 0;
    return Math.hypot(real[to] - real[from], imaginary[to] - imaginary[from]) / half;
  });
}

// by table, the amplitude and the frequencies of a trial's steps; empty if it has none
function measuredSteps(columns) {
  const named = Object.entries(columns).filter(([name, data]) => /^[\d.]+ deg$/.test(name) && data.frequency_hz);
  return named.map(([name, data]) => ({ name, amplitude_deg: Number.parseFloat(name), frequencies_hz: [...data.frequency_hz] }));
}

// for each sample the frequency and the amplitude at which the angle moves most
function motionOfSamples(time, theta_deg, frequencies_hz) {
  const amplitudes = frequencies_hz.map((frequency_hz) => amplitudesAround(time, theta_deg, frequency_hz));
  return Array.from(time, (_, k) => {
    const at = amplitudes.reduce((best, values, i) => (values[k] > amplitudes[best][k] ? i : best), 0);
    return { frequency_hz: frequencies_hz[at], amplitude_deg: amplitudes[at][k] };
  });
}

function isOfStep(motion, amplitude_deg, frequency_hz) {
  const isOfAmplitude = !amplitude_deg || Math.abs(motion.amplitude_deg - amplitude_deg) <= AMPLITUDE_SHARE * amplitude_deg;
  return isOfAmplitude && (!frequency_hz || motion.frequency_hz === frequency_hz);
}

function choiceOf(label, texts) {
  const options = texts.map(([value, text]) => element("option", { value }, text));
  const select = element("select", { "data-choice": label }, element("option", { value: "" }, "all"), ...options);
  return { select, field: element("label", {}, `${label} `, select) };
}

// two choices for a loop; `show` is called with whether a sample is of the chosen step. null where there are no steps
function loopChoice(columns, show) {
  const steps = measuredSteps(columns);
  const data = columns.series;
  if (!steps.length || !data?.time || !data.theta_deg) return null;
  const frequencies_hz = [...new Set(steps.flatMap((step) => step.frequencies_hz))].sort((a, b) => a - b);
  const amplitude = choiceOf("Amplitude", steps.map(({ amplitude_deg, name }) => [amplitude_deg, name]));
  const frequency = choiceOf("Frequency", frequencies_hz.map((value) => [value, `${Number(value.toPrecision(3))} Hz`]));
  let motions = null;  // computed once somebody chooses
  const choose = () => {
    motions ??= motionOfSamples(data.time, data.theta_deg, frequencies_hz);
    const [amplitude_deg, frequency_hz] = [Number(amplitude.select.value), Number(frequency.select.value)];
    show((k) => isOfStep(motions[k], amplitude_deg, frequency_hz));
  };
  for (const { select } of [amplitude, frequency]) select.addEventListener("change", choose);
  return element("div", { class: "loop-choice" }, amplitude.field, frequency.field);
}
