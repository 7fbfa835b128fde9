% The System Identification Toolbox and NLID on the same recordings: matlab_sysid(FOLDER) writes FOLDER/answers_matlab.csv,
% which score.py reads. It was not run for docs/peers.md.
%
% Grey box: https://www.mathworks.com/help/ident/ref/iddata.greyest.html (idgrey, delayest, getpvec with its covariance).
% NLID (REKLAB, McGill University, https://github.com/reklab/reklab_public): the compliance as an impulse response from
% torque to angle (irf, nlident), whose second-order fit has K, B and I. What is not installed is left out.
function matlab_sysid(folder)
truth = readtable(fullfile(folder, 'truth.csv'), 'TextType', 'string');
rows = {};
for k = 1:height(truth)
    data = readmatrix(fullfile(folder, truth.trial(k) + ".csv"));
    rate = str2double(regexp(truth.known(k), 'rate_hz=(\S+)', 'tokens', 'once'));
    even = (data(1, 1):1 / rate:data(end, 1))';
    theta = interp1(data(:, 1), data(:, 2), even);
    torque = interp1(data(:, 1), data(:, 3), even);
    if license('test', 'Identification_Toolbox')
        used = "System Identification Toolbox " + ver('ident').Version;
        rows(end + 1, :) = timed("matlab_greyest", truth.trial(k), used, @() grey_box(theta, torque, rate)); %#ok<AGROW>
    end
    if exist('nlident', 'file')
        rows(end + 1, :) = timed("matlab_nlid", truth.trial(k), "NLID", @() nlid(theta, torque, rate)); %#ok<AGROW>
    end
end
names = {'method', 'trial', 'K', 'K_low', 'K_high', 'B', 'B_low', 'B_high', 'I', 'I_low', 'I_high', 'doubtful', ...
    'seconds', 'megabytes', 'version'};
writetable(cell2table(rows, 'VariableNames', names), fullfile(folder, 'answers_matlab.csv'));
end

function row = timed(method, trial, version, estimate)
began = cputime;
try
    [found, half, doubt] = estimate();
catch problem
    [found, half, doubt] = deal(nan(1, 3), nan(1, 3), "refused: " + problem.message);
end
ends = [found; found - half; found + half];
row = [{method, trial}, num2cell(ends(:)'), {doubt, cputime - began, nan, version}];
end

function [found, half, doubt] = grey_box(theta, torque, rate)
% Angle of a joint that the torque drives; the lag that delayest finds is taken off the torque.
data = detrend(iddata(theta, torque, 1 / rate, 'InterSample', 'foh'), 0);
late = delayest(data, 2, 2, -20, 20);
if late < 0
    data = iddata(data.y(1:end + late), data.u(1 - late:end), 1 / rate, 'InterSample', 'foh');
end
start = idgrey(@joint, {'K', 100; 'B', 2; 'I', 0.02}, 'c');
options = greyestOptions('InitialState', 'estimate', 'Display', 'off');
model = greyest(data, start, options);
[found, deviation] = getpvec(model);
[found, half] = deal(found', 1.96 * deviation');
doubt = "";
if late < 0
    doubt = sprintf("torque late by %d samples, corrected", -late);
end
end

function [A, input, C, D] = joint(K, B, I, ~)
[A, input, C, D] = deal([0 1; -K / I, -B / I], [0; 1 / I], [1 0], 0);
end

function [found, half, doubt] = nlid(theta, torque, rate)
% Low-pass and decimate to 100 Hz, as its joint demos do; the gain of the compliance over frequency has K, B and I.
q = round(rate / 100);
both = [decimate(torque - mean(torque), q), decimate(theta - mean(theta), q)];
response = nlident(irf, nldat(both, 'domainIncr', q / rate), 'nLags', 40, 'nSides', 2);
lags = ((0:length(double(response)) - 1)' - 40) * q / rate;
s = 2i * pi * linspace(0.5, 6, 50)';
stiffness = 1 ./ (exp(-s * lags') * double(response) * q / rate);
X = [ones(size(s)), s, s .^ 2];
found = ([real(X); imag(X)] \ [real(stiffness); imag(stiffness)])';
[half, doubt] = deal(nan(1, 3), "");
end
