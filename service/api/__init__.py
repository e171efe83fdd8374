"""REST, the technician's page and Prometheus' metrics: rows in, JSON out; no hardware behind it."""
