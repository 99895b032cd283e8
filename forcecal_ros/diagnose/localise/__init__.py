"""Where the residual is more than noise: stage, channel, phase and frequency band."""
