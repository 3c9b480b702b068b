function [s_cmd, s_rply] = tcp_setup(role, port1, port2)
s_cmd = tcpip('0.0.0.0', port1, 'NetworkRole', role, 'InputBufferSize', 1024); % commands
reply = fread(s_rply, 1, 'double');
end
