# An image for the MLflow server and for workers; compose.yaml uses it for both.
FROM python:3.11-slim
WORKDIR /opt/islandgp
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY conf conf
COPY grammar grammar
COPY prompts prompts
COPY examples/templates examples/templates
COPY islandgp islandgp
RUN pip install --no-cache-dir '.[postgresql]' -c constraints.txt \
    && useradd --create-home worker && mkdir -p /srv/islandgp/runs /artifacts && chown -R worker /srv/islandgp /artifacts
USER worker
WORKDIR /srv/islandgp
CMD ["python", "-m", "islandgp"]
