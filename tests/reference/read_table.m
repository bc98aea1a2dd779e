function [values, names] = read_table(path)
% READ_TABLE  Numbers of a CSV file with one header line, one row a line; 'nan' is NaN. Every bit is kept.
  fid = fopen(path, 'r');
  if fid < 0
    error('read_table:missing', 'no file %s', path);
  end
  names = strsplit(strtrim(fgetl(fid)), ',');
  format = [repmat('%f,', 1, numel(names) - 1) '%f'];
  values = reshape(fscanf(fid, format), numel(names), [])';
  fclose(fid);
end
