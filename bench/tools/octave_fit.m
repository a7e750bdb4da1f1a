% Fits of one log in GNU Octave. Called as: octave-cli octave_fit.m FIT LOG.csv "[guess]"
% Prints SECONDS and the estimates. Needs the packages control and optim.
1;

function y = simulate_p1 (t, p, u)
  w = max (u - p(2), 0) + min (u - p(1), 0);
  y = lsim (tf (1, [p(3), p(4), 0]), w, t);   % lsim moves a sampled input straight (foh)
endfunction

function y = simulate_p2 (t, p, u)
  h = t(2) - t(1);
  d = c2d (tf (p(1)^2, [1, 2*p(2)*p(1), p(1)^2]), h, "zoh");
  [b, a] = tfdata (d, "vector");
  y = filter ([zeros(1, numel (a) - numel (b)), b], a, u);
endfunction

function y = simulate_p3 (t, p, u)
  h = t(2) - t(1);
  dead = max (p(3), 0);
  whole = floor (dead / h);
  tau = max (p(2), 1e-4);
  new = exp (-(h*(whole + 1) - dead) / tau);
  a = exp (-h / tau);
  y = filter ([zeros(1, whole + 1), p(1)*(1 - new), p(1)*(new - a)], [1, -a], u);
endfunction

pkg load control optim
arguments = argv ();
data = csvread (arguments{2});
t = data(:, 1); u = data(:, 2); y = data(:, 3);
guess = eval (arguments{3})(:);
scale = guess;
tic ();
switch (arguments{1})
  case {"P1", "P2", "P3"}
    model = str2func (["simulate_" tolower(arguments{1})]);
    [~, q] = leasqr (t, y / std (y), ones (size (guess)), ...
                     @(t, q) model (t, q .* scale, u) / std (y), 1e-8, 100);
    theta = q .* scale;
  case "P2n4sid"
    s = n4sid (iddata (y, u, t(2) - t(1)), 2);
    poles = log (eig (s.a)) / (t(2) - t(1));
    theta = [sqrt(real (prod (poles))); 0];
    theta(2) = -real (sum (poles)) / (2 * theta(1));
endswitch
seconds = toc ();
printf ("SECONDS %.9g\n", seconds);
printf ("THETA %s\n", mat2str (theta', 15));
