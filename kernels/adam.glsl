// Applies Adam with wrapping, on the gradient 2 Im(G conj(u)). The including shader has the buffers `shown`, `phases`,
// `first_moment` and `second_moment`, and the arguments.
void adam(uint at, vec2 g) {
    float phase = phases[at];
    vec2 u = cos_sin(shown[at]);
    float gradient = 2.0 * (g.y * u.x - g.x * u.y);
    float m = beta1 * first_moment[at] + (1.0 - beta1) * gradient;
    float v = beta2 * second_moment[at] + (1.0 - beta2) * (gradient * gradient);
    first_moment[at] = m;
    second_moment[at] = v;
    phases[at] = wrap(phase - rate * (m * correct1) / (sqrt(v * correct2) + epsilon));
}
