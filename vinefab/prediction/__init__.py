"""What a design is expected to do: deployments, measures, sensitivity, pressure, anchoring."""
